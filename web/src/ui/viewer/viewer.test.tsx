// @vitest-environment happy-dom
import { act, cleanup, render, screen, waitFor } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { config, settings } from "../../state/app";
import { serverConfig } from "../../state/fake-server";
import type { Asked } from "../../state/route";
import { DEFAULT_SETTINGS } from "../../state/settings";
import { NO_STATS } from "../../stateless/stats";
import { type FakeSession, fakeDash, fakeSession } from "../../viewer/fake-session";
import { Viewer } from "./viewer";

vi.mock("../chart/live-plot", () => ({ plotLive: () => () => undefined }));
vi.mock("../chart/distribution-plot", () => ({ plotDistribution: () => () => undefined }));
const visits = vi.hoisted(() => ({ opened: [] as unknown[][], next: undefined as unknown }));
vi.mock("../../viewer/session", () => ({
  ViewerSession: class {
    constructor(...options: unknown[]) {
      visits.opened.push(options);
      // biome-ignore lint/correctness/noConstructorReturn: the test's own session in place of one that connects
      return visits.next as object;
    }
  },
}));

let session: FakeSession;

beforeEach(() => {
  settings.value = { ...DEFAULT_SETTINGS, sidebar: false };
  config.value = serverConfig();
  session = fakeSession();
  visits.opened = [];
  visits.next = session;
});

afterEach(cleanup);

const show = (asked: Asked = {}) => render(<Viewer sceneId="courtyard" stamp={false} asked={asked} />);
const stage = () => screen.getByRole("application");

test("opens the scene, names it, and gives the keys to the stage", () => {
  show();
  expect(visits.opened.map(([scene, , stamp]) => [scene, stamp])).toEqual([["courtyard", false]]);
  expect(document.title).toBe("Courtyard · TIGAS");
  expect(screen.getByRole("heading", { name: "Courtyard", level: 1 })).toBeTruthy();
  expect(document.activeElement).toBe(stage());
});

test("the stage tells scripts how it stands", async () => {
  show();
  await act(() => {
    session.stateless.stats.value = { ...NO_STATS, shown: 4, settled: false, transport: "fetch" };
    session.dash.value = fakeDash({ kind: "connecting" }, { shown: 2 });
  });
  expect({ ...stage().dataset }).toEqual({
    phase: "playing",
    transport: "fetch",
    frames: "4",
    settled: "false",
    mode: "stateless",
    dash: "connecting",
    dashFrames: "2",
    local: "off",
    localComplete: "false",
  });
});

test("keys open help, hide the measurements, open the settings and change the mode", async () => {
  const user = userEvent.setup();
  show();
  await user.keyboard("h");
  const help = screen.getByRole("dialog", { name: "Getting around" });
  expect(help).toHaveProperty("open", true);
  await user.keyboard("h");
  await waitFor(() => expect(help).toHaveProperty("open", false));
  stage().focus();
  await user.keyboard("i");
  expect(screen.queryByRole("region", { name: "Measurements" })).toBeNull();
  await user.keyboard("i");
  expect(screen.getByRole("region", { name: "Measurements" })).toBeTruthy();
  await user.keyboard("p");
  expect(screen.getByRole("complementary", { name: "Settings" })).toBeTruthy();
  const modes: string[] = [];
  for (let i = 0; i < 4; i++) {
    await user.keyboard("m");
    modes.push(settings.value.mode);
  }
  expect(modes).toEqual(["video", "dash", "side-by-side", "local"]);
});

test("r brings back the start view, to the last bit", async () => {
  show();
  const { position, quaternion } = session.rig.pose;
  session.rig.drive(() => ({ position: [1, 2, 3], quaternion: [0, 1, 0, 0] }));
  session.rig.sample(20);
  session.rig.takeOver();
  expect(session.rig.pose.position).not.toEqual(position);
  await userEvent.keyboard("r");
  expect(session.rig.pose).toMatchObject({ position, quaternion });
});

test("what is typed into a field, or with a modifier, is no shortcut", async () => {
  const user = userEvent.setup();
  settings.value = { ...DEFAULT_SETTINGS, sidebar: true };
  show();
  await user.type(screen.getByRole("spinbutton", { name: /Turn/ }), "i");
  stage().focus();
  await user.keyboard("{Control>}i{/Control}");
  expect(settings.value.hud).toBe(true);
});

test("the measurements are those of the mode", async () => {
  show();
  await act(() => {
    settings.value = { ...settings.value, mode: "side-by-side" };
    session.dash.value = fakeDash({ kind: "playing" }, { liveLatency: 320, stalls: { count: 2, time: 1500 } });
  });
  const names = screen.getAllByRole("region").map((region) => region.getAttribute("aria-label"));
  expect(names).toEqual(["Measurements: Stateless", "Measurements: DASH"]);
  const dash = screen.getByRole("region", { name: "Measurements: DASH" });
  expect(dash.querySelector("[data-stat=live-latency]")?.textContent).toBe("320 ms");
  expect(dash.querySelector("[data-stat=stalls]")?.textContent).toBe("2, 1.5 s");
  await act(() => {
    settings.value = { ...settings.value, mode: "dash" };
  });
  expect(screen.getAllByRole("region")).toHaveLength(1);
});

test("where this browser cannot decode video, the mode Video says so, and the others do not", async () => {
  session.video.problem.value = "This browser does not decode H.264.";
  settings.value = { ...settings.value, mode: "video" };
  show();
  expect(screen.getByText("This browser does not decode H.264.")).toBeTruthy();
  await act(() => {
    settings.value = { ...settings.value, mode: "stateless" };
  });
  expect(screen.queryByText("This browser does not decode H.264.")).toBeNull();
});

test.each([
  [{ kind: "connecting" }, "Connecting…"],
  [{ kind: "loading" }, "Loading the scene…"],
  [{ kind: "lost", message: "The server does not answer." }, "The server does not answer. Trying again…"],
  [{ kind: "full" }, "The server is full. The scene opens by itself as soon as there is room."],
] as const)("a visit that is %j says: %s", (phase, sentence) => {
  session.phase.value = phase;
  show();
  expect(screen.getByText(sentence)).toBeTruthy();
});

test("a visit that failed says why, can be tried again, and offers the way back", async () => {
  session.phase.value = { kind: "failed", message: "There is no scene courtyard." };
  show();
  expect(screen.getByText("There is no scene courtyard.")).toBeTruthy();
  expect(screen.queryByRole("region", { name: "Measurements" })).toBeNull();
  expect(screen.getByRole("link", { name: "All scenes" }).getAttribute("href")).toBe("#/");
  await userEvent.click(screen.getByRole("button", { name: "Try again" }));
  expect(session.retries).toBe(1);
});

test.each([
  [{ kind: "connecting" }, "Starting the stream…"],
  [{ kind: "lost", message: "The stream broke." }, "The stream broke. Trying again…"],
  [{ kind: "failed", message: "This browser cannot." }, "This browser cannot."],
] as const)("a stream that is %j says: %s", (phase, sentence) => {
  settings.value = { ...settings.value, mode: "dash" };
  session.dash.value = fakeDash(phase);
  show();
  expect(screen.getByText(sentence)).toBeTruthy();
});

test("frames that are refused say why, unless none are asked for", async () => {
  session.stateless.problem.value = "The server has no memory left.";
  show();
  expect(screen.getByText("The server has no memory left.")).toBeTruthy();
  await act(() => {
    settings.value = { ...settings.value, mode: "dash" };
  });
  expect(screen.queryByText("The server has no memory left.")).toBeNull();
});

test("scripts can drive the viewer for as long as it is open", async () => {
  const { unmount } = show();
  expect(window.tigas?.state()).toMatchObject({ phase: "playing", mode: "stateless" });
  unmount();
  await waitFor(() => expect(session.disposed).toBe(true));
  expect(window.tigas).toBeUndefined();
});

test("models that the URL names are chosen, and remembered", () => {
  show({ restore: "anime4k-restore-m" });
  expect(settings.value).toMatchObject({ restore: "anime4k-restore-m", upscale: "off" });
});

test("a URL that names a model which there is not says so, and chooses none", () => {
  settings.value = { ...settings.value, restore: "anime4k-restore-m", upscale: "bicubic" };
  show({ upscale: "magic" });
  expect(settings.value).toMatchObject({ restore: "anime4k-restore-m", upscale: "off" });
  expect(screen.getByText(/Enhancement is off. There is no model “magic” to upscale with, only off, /)).toBeTruthy();
});

test("a URL may say how movement is met, and what makes no sense in it changes nothing", () => {
  show({ reprojection: "off", prediction: "linear" });
  expect(settings.value).toMatchObject({ reprojection: false, prediction: "linear" });
  expect(document.querySelector("[data-stat=link-note]")).toBeNull();
  cleanup();
  show({ reprojection: "maybe", prediction: "magic" });
  expect(settings.value).toMatchObject({ reprojection: false, prediction: "linear" });
  expect(screen.getByText("The link sets reprojection to “maybe”: it is either on or off.")).toBeTruthy();
});

test.each([
  [
    { prediction: "magic" },
    undefined,
    /^The link names a prediction that does not exist, “magic”; choose one of off, velocity, /,
  ],
  [{}, ["predicton"], /^The link names “predicton”, which is nothing here; it may name restore, upscale, /],
])("a URL with %o and %o says what makes no sense in it", (asked, unknown, sentence) => {
  render(<Viewer sceneId="courtyard" stamp={false} asked={asked} unknown={unknown} />);
  expect(screen.getByText(sentence)).toBeTruthy();
});

test("what a person should know of enhancement is said", async () => {
  show();
  await act(() => {
    session.enhancement.status.value = { kind: "starting", message: null };
  });
  expect(document.querySelector("[data-stat=enhancement-note]")).toBeNull();
  await act(() => session.enhancement.giveUp("It took 40 ms a frame."));
  expect(screen.getByText("Enhancement is off. It took 40 ms a frame.")).toBeTruthy();
});
