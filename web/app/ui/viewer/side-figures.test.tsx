// @vitest-environment happy-dom
import { cleanup, render, screen } from "@testing-library/preact";
import { afterEach, expect, test } from "vitest";
import { COURTYARD } from "#fakes/server";
import { asSession, fakeLocal, fakeSession } from "#fakes/session";
import { type LocalStats, NO_LOCAL_STATS } from "#viewer/local/local-player";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { changeSettings, settings } from "../../state/app";
import { Rows } from "./hud";
import { ModePanel } from "./mode-panel";
import { localRows } from "./side-figures";
import { StageMessage } from "./stage-message";

afterEach(() => {
  cleanup();
  settings.value = DEFAULT_SETTINGS;
});

const shown = (stats: Partial<LocalStats>) => {
  const { container } = render(<Rows of={localRows({ ...NO_LOCAL_STATS, ...stats })} />);
  return (name: string) => container.querySelector(`[data-stat="${name}"]`)?.textContent;
};

test("the HUD shows progress of the download, and the part that is drawn", () => {
  const half = { received: 3_000_000, total: 7_600_000, drawn: 20_000, gaussians: 298_886, firstPictureMs: 812 };
  const stat = shown({ ...half, backend: "WebGL 2" });
  expect(["downloaded", "gaussians", "first-picture", "complete", "renderer"].map(stat)).toEqual([
    "3 MB of 7.6 MB",
    "20,000 of 298,886",
    "0.8 s",
    "–",
    "WebGL 2",
  ]);
  expect(screen.getByRole("progressbar", { name: "Download" })).toHaveProperty("value", 3_000_000);
});

test("a whole scene has no progress any more", () => {
  const all = { received: 7_600_000, total: 7_600_000, drawn: 298_886, gaussians: 298_886 };
  const stat = shown({ ...all, firstPictureMs: 812, completeMs: 12_340 });
  expect(["downloaded", "gaussians", "complete"].map(stat)).toEqual(["7.6 MB", "298,886", "12.3 s"]);
  expect(screen.queryByRole("progressbar")).toBeNull();
});

test.each([
  [{ kind: "playing" } as const, ""],
  [null, "This server does not offer the scene for download. Choose another mode in the lab, or Stream under View."],
])("the stage says how a download stands: %j", (phase, said) => {
  changeSettings({ mode: "local" });
  const session = fakeSession();
  session.left.source.value = phase && fakeLocal(phase);
  session.left.missing.value = phase ? null : "This server does not offer the scene for download";
  render(<StageMessage session={asSession(session)} />);
  expect(screen.getByRole("status").textContent).toBe(said);
});

test("levels of detail are offered for a scene that has them", () => {
  changeSettings({ mode: "local" });
  const session = fakeSession();
  session.scene.value = { ...COURTYARD, downloads: [{ form: "compressed" }] };
  render(<ModePanel session={asSession(session)} />);
  expect(screen.queryByRole("radio", { name: "Levels of detail" })).toBeNull();
  cleanup();
  session.scene.value = { ...COURTYARD, downloads: [{ form: "compressed" }, { form: "streamed" }] };
  render(<ModePanel session={asSession(session)} />);
  expect(screen.getByRole("radio", { name: "Levels of detail" })).toBeTruthy();
});

test("the panel describes the download, or its absence", () => {
  changeSettings({ mode: "local" });
  const session = fakeSession();
  render(<ModePanel session={asSession(session)} />);
  expect(screen.getByText(/^This browser draws the scene/)).toBeTruthy();
  expect(screen.queryByRole("alert")).toBeNull();
  cleanup();
  session.left.missing.value = "This server does not offer the scene for download";
  render(<ModePanel session={asSession(session)} />);
  expect(screen.getByRole("alert").textContent).toContain("does not offer the scene for download");
});
