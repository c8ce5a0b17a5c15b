// @vitest-environment happy-dom
import { signal } from "@preact/signals";
import { act, cleanup, render, screen } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeAll, beforeEach, expect, test, vi } from "vitest";
import type { SessionStatus } from "#client/wire/dash";
import { serverConfig } from "#fakes/server";
import { type FakeSession, fakeLocal, fakeSession, fakeSide, fakeStream, WALKED_SIDE } from "#fakes/session";
import { visit } from "#fakes/visit";
import { ComparisonHistory } from "#viewer/charts/history";
import type { Walk } from "#viewer/charts/walk";
import { type Comparison, UNSCORED } from "#viewer/session/comparison";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { NO_STATS } from "#viewer/stateless/stats";
import { config, settings } from "../../state/app";
import { Viewer } from "./viewer";

vi.mock("../chart/plots", () => ({ plotLive: () => () => undefined, plotDistribution: () => () => undefined }));
vi.mock("#viewer/session/session", () => import("#fakes/visit"));

let session: FakeSession;

/** Loads the parts that are loaded on demand, so that a busy machine shows them in time. */
beforeAll(async () => {
  await Promise.all([import("./side-figures"), import("./panels"), import("./last-walk")]);
});

beforeEach(() => {
  settings.value = { ...DEFAULT_SETTINGS, sidebar: false };
  config.value = serverConfig();
  session = fakeSession();
  visit.next = session;
});

afterEach(cleanup);

const show = () => render(<Viewer sceneId="courtyard" asked={{}} />);

test("a picture that stands still for a second is called frozen, also where there are no measurements", async () => {
  settings.value = { ...DEFAULT_SETTINGS, hud: false };
  show();
  const freeze = async (frozenFor: number) => {
    await act(() => {
      session.pictures.stats.value = { ...NO_STATS, frozenFor };
    });
    return document.querySelector("[data-stat=frozen]")?.textContent;
  };
  expect(await freeze(600)).toBeUndefined();
  expect(await freeze(2300)).toBe("Frozen, no new picture for 2.3 s");
  await act(() => {
    session.phase.value = { kind: "lost", message: "QUIC did not respond in time." };
  });
  expect(document.querySelector("[data-stat=frozen]"), "the message of a lost stream is enough").toBeNull();
});

test("the measurements are those of the mode", async () => {
  settings.value = { ...settings.value, hudDetails: true };
  show();
  await screen.findByRole("region", { name: "Measurements" });
  await act(() => {
    settings.value = { ...settings.value, mode: "side-by-side", left: "local", right: "dash-edge" };
    session.left.source.value = fakeLocal({ kind: "playing" }, { drawn: 300 });
    const stream = fakeStream(
      { kind: "playing" },
      { liveLatency: 320, stalls: { count: 2, time: 1500 }, motionToPhoton: { p50: 80, p95: 90 } },
    );
    session.right.value = fakeSide("right", stream);
  });
  const names = screen.getAllByRole("region").map((region) => region.getAttribute("aria-label"));
  expect(names).toEqual(["Measurements: Local", "Measurements: DASH, edge"]);
  const local = screen.getByRole("region", { name: "Measurements: Local" });
  expect(local.querySelector("[data-stat=gaussians]")?.textContent).toBe("–");
  const dash = screen.getByRole("region", { name: "Measurements: DASH, edge" });
  expect(dash.querySelector("[data-stat=live-latency]")?.textContent).toBe("320 ms");
  expect(dash.querySelector("[data-stat=stalls]")?.textContent).toBe("2, 1.5 s");
  await userEvent.click(screen.getAllByRole("button", { name: "Fewer measurements" })[0] as HTMLElement);
  expect(document.querySelector("[data-stat=stalls]"), "both sides keep their main figure only").toBeNull();
  const line = screen.getByRole("region", { name: "Status: DASH, edge" });
  expect(line.querySelector("[data-stat=motion-to-photon]")?.textContent).toBe("80");
  await act(() => {
    settings.value = { ...settings.value, mode: "dash" };
    session.right.value = null;
  });
  expect(screen.getAllByRole("region")).toHaveLength(1);
});

/** Two sides, and their last walk. */
function compare(walk: Walk | null): void {
  session.comparison.value = {
    sides: [session.left, fakeSide("right")],
    history: new ComparisonHistory(2),
    walks: { last: signal(walk) },
    quality: signal(UNSCORED),
  } as unknown as Comparison;
}

test("two columns of measurements leave no room for the hint", async () => {
  settings.value = { ...settings.value, mode: "side-by-side", right: "video", hint: true, hudDetails: false };
  compare(null);
  show();
  expect(screen.queryByText(/^Drag to look/)).not.toBeNull();
  await act(() => {
    settings.value = { ...settings.value, hudDetails: true };
  });
  await screen.findByRole("region", { name: /^Measurements/ });
  expect(screen.queryByText(/^Drag to look/)).toBeNull();
});

test("while the settings are closed, the last walk is summed up over the stage, and leads to them", async () => {
  settings.value = { ...settings.value, mode: "side-by-side", right: "video" };
  compare({ duration: 5000, sides: [WALKED_SIDE, { ...WALKED_SIDE, contentAge: WALKED_SIDE.contentAge + 50 }] });
  show();
  const said = await screen.findByRole("button", { name: /^Stateless was 50 ms more up to date than Video/ });
  await userEvent.click(said);
  expect((await screen.findByRole("region", { name: "Last walk" })).textContent).toContain("Stateless was 50 ms");
  expect(said.isConnected).toBe(false);
});

test("a stream of repeated frames blames the server, and a slow machine itself", async () => {
  vi.useFakeTimers({ toFake: ["setInterval", "clearInterval", "performance"] });
  settings.value = { ...settings.value, mode: "dash", hudDetails: true };
  let ticks = 0;
  const stream = fakeStream({ kind: "playing" });
  stream.status = async () => ({ id: "a", frames: 60 * ticks, repeated: 45 * ticks++, dropped: 0 }) as SessionStatus;
  session.left.source.value = stream;
  show();
  for (let i = 0; i < 60; i++) {
    session.rig.sample(performance.now());
    await act(async () => void (await vi.advanceTimersByTimeAsync(100)));
  }
  vi.useRealTimers();
  expect(screen.getByText(/^The server is slow, not your connection: 75 % of the stream’s frames/)).toBeTruthy();
  expect(screen.getByText("This device is slow: it shows only 10 pictures per second.")).toBeTruthy();
});

/** A screen on which these media queries match; the viewer on it, with the lab open. */
async function showOn(matching: (query: string) => boolean) {
  vi.stubGlobal("matchMedia", (query: string) => Object.assign(new EventTarget(), { matches: matching(query) }));
  settings.value = { ...DEFAULT_SETTINGS, sidebar: true };
  show();
  vi.unstubAllGlobals();
  await screen.findByRole("heading", { name: "Lens" });
  const details = await screen.findByRole("button", { name: /measurements/ });
  return details.getAttribute("aria-expanded") === "true";
}

test("beside the lab, all measurements are shown only where there is room, and not on touch screens", async () => {
  const wide = (query: string) => query === "(min-width: 800px) and (min-height: 500px)";
  expect(await showOn(wide)).toBe(true);
  cleanup();
  expect(await showOn((query) => wide(query) || query === "(pointer: coarse)")).toBe(false);
  cleanup();
  expect(await showOn((query) => query === "(pointer: coarse)"), "a phone").toBe(false);
});

test("the line says when there is no connection", async () => {
  show();
  const status = () => screen.getByRole("region", { name: "Status" }).textContent;
  expect(status()).toContain("Live");
  await act(() => {
    session.phase.value = { kind: "lost", message: "The server is not responding." };
  });
  expect(status()).toContain("Not connected");
});

test("a newcomer sees one line and how to move, until the first movement; the lab is closed", async () => {
  settings.value = DEFAULT_SETTINGS;
  session.pictures.stats.value = { ...NO_STATS, newViewsPerSecond: 23.6, motionToPhoton: { p50: 48.2, p95: 90 } };
  show();
  expect(screen.getByRole("region", { name: "Status" }).textContent).toBe("Live24 views/s48 ms");
  expect(screen.queryByRole("complementary", { name: "Lab" })).toBeNull();
  expect(screen.queryByRole("button", { name: /measurements/ })).toBeNull();
  const hint = () => screen.queryByText("Drag to look · WASD or wheel to move · double-click to go there");
  await act(() => {
    session.rig.sample(20);
    session.rig.place({ position: [1, 2, 3], quaternion: [0, 0, 0, 1] });
    session.rig.sample(40);
  });
  expect(hint(), "a link's place is no movement").not.toBeNull();
  await act(() => {
    session.axes = { ...session.axes, forward: 1 };
    session.rig.sample(60);
  });
  expect(hint()).toBeNull();
  expect(settings.value.hint).toBe(false);
});

test("the status of enhancement is shown", async () => {
  show();
  await act(() => {
    session.pictures.enhancement.status.value = { kind: "starting", message: null };
  });
  expect(document.querySelector("[data-stat=enhancement-note]")).toBeNull();
  await act(() => {
    session.pictures.enhancement.status.value = { kind: "failed", message: "It took 40 ms per frame." };
  });
  expect(screen.getByText("Enhancement is off. It took 40 ms per frame.")).toBeTruthy();
});
