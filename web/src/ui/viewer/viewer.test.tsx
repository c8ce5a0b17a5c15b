// @vitest-environment happy-dom
import { signal } from "@preact/signals";
import { act, cleanup, render, screen, waitFor } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ComparisonHistory } from "../../charts/history";
import { config, settings } from "../../state/app";
import { serverConfig } from "../../state/fake-server";
import type { Asked } from "../../state/route";
import { DEFAULT_SETTINGS } from "../../state/settings";
import { NO_STATS } from "../../stateless/stats";
import { type Comparison, UNSCORED } from "../../viewer/comparison";
import { type FakeSession, fakeLocal, fakeSession, fakeSide, fakeStream } from "../../viewer/fake-session";
import type { SessionStatus } from "../../wire/dash";
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
    session.stream.value = fakeStream({ kind: "connecting" }, { shown: 2 });
  });
  expect({ ...stage().dataset }).toEqual({
    phase: "playing",
    transport: "fetch",
    frames: "4",
    settled: "false",
    mode: "stateless",
    stream: "connecting",
    streamFrames: "2",
    local: "off",
    localComplete: "false",
  });
});

test("keys open help, hide the measurements, open the settings and change the mode", async () => {
  const user = userEvent.setup();
  show();
  await user.keyboard("h");
  expect(screen.getByRole("dialog", { name: "Getting around" })).toHaveProperty("open", true);
  await user.keyboard("h");
  await waitFor(() => expect(screen.queryByRole("dialog")).toBeNull());
  expect(document.activeElement).toBe(stage());
  await user.keyboard("i");
  expect(screen.queryByRole("region", { name: "Measurements" })).toBeNull();
  await user.keyboard("i");
  expect(screen.getByRole("region", { name: "Measurements" })).toBeTruthy();
  await user.keyboard("p");
  expect(screen.getByRole("complementary", { name: "Settings" })).toBeTruthy();
  const modes: string[] = [];
  for (let i = 0; i < 5; i++) {
    await user.keyboard("m");
    modes.push(settings.value.mode);
  }
  expect(modes).toEqual(["video", "dash", "webrtc", "side-by-side", "local"]);
});

test("a dialogue gives the focus back to what opened it, and the settings give it to the stage", async () => {
  const user = userEvent.setup();
  show();
  const help = screen.getByRole("button", { name: "Help" });
  help.focus();
  await user.keyboard("{Enter}");
  await user.keyboard("{Enter}"); // on its button to close it, which is first
  await waitFor(() => expect(screen.queryByRole("dialog")).toBeNull());
  expect(document.activeElement).toBe(help);
  await user.keyboard("p");
  expect(document.activeElement).toBe(help);
  screen.getByRole("button", { name: "Close settings" }).focus();
  await user.keyboard("{Enter}");
  expect(document.activeElement).toBe(stage());
});

test("fullscreen leaves the settings away until they are asked for, and gives them back at its end", async () => {
  settings.value = { ...DEFAULT_SETTINGS, sidebar: true };
  show();
  const shown = () => screen.queryByRole("complementary", { name: "Settings" }) !== null;
  const turn = (on: boolean) =>
    act(() => {
      Object.assign(document, { fullscreenElement: on ? stage() : null }); // happy-dom has none
      document.dispatchEvent(new Event("fullscreenchange"));
    });
  await turn(true);
  expect(shown()).toBe(false);
  await userEvent.keyboard("p");
  expect(shown()).toBe(true);
  await turn(false);
  await turn(true);
  expect(shown()).toBe(false);
  await turn(false);
  expect(shown()).toBe(true);
});

test("a picture that stands still for a second is called frozen, also where there are no measurements", async () => {
  settings.value = { ...DEFAULT_SETTINGS, hud: false };
  show();
  const freeze = async (frozenFor: number) => {
    await act(() => {
      session.stateless.stats.value = { ...NO_STATS, frozenFor };
    });
    return document.querySelector("[data-stat=frozen]")?.textContent;
  };
  expect(await freeze(600)).toBeUndefined();
  expect(await freeze(2300)).toBe("Frozen, no new picture for 2.3 s");
  await act(() => {
    session.phase.value = { kind: "lost", message: "QUIC did not answer in time." };
  });
  expect(document.querySelector("[data-stat=frozen]"), "what is lost says so").toBeNull();
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
    settings.value = { ...settings.value, mode: "side-by-side", left: "local-ply", right: "dash-edge" };
    session.local.value = fakeLocal({ kind: "playing" }, { drawn: 300 });
    const right = fakeSide("right");
    right.stream.value = fakeStream({ kind: "playing" }, { liveLatency: 320, stalls: { count: 2, time: 1500 } });
    session.right.value = right;
  });
  const names = screen.getAllByRole("region").map((region) => region.getAttribute("aria-label"));
  expect(names).toEqual(["Measurements: Local, PLY", "Measurements: DASH, edge"]);
  const local = screen.getByRole("region", { name: "Measurements: Local, PLY" });
  expect(local.querySelector("[data-stat=gaussians]")?.textContent).toBe("–");
  const dash = screen.getByRole("region", { name: "Measurements: DASH, edge" });
  expect(dash.querySelector("[data-stat=live-latency]")?.textContent).toBe("320 ms");
  expect(dash.querySelector("[data-stat=stalls]")?.textContent).toBe("2, 1.5 s");
  await act(() => {
    settings.value = { ...settings.value, mode: "dash" };
    session.right.value = null;
  });
  expect(screen.getAllByRole("region")).toHaveLength(1);
});

test("while the settings are closed, the last walk is summed up over the stage, and leads to them", async () => {
  settings.value = { ...settings.value, mode: "side-by-side", right: "video" };
  const side = {
    inputs: 9,
    latency: { p50: 40, p95: 90 },
    newViewsPerSecond: 12,
    bandwidth: 1e6,
    bytes: 1e6,
    stalled: 0,
  };
  const walk = { duration: 5000, sides: [side, { ...side, latency: { p50: 90, p95: 99 } }] };
  session.comparison.value = {
    sides: [session.left, fakeSide("right")],
    history: new ComparisonHistory(2),
    walks: { last: signal(walk) },
    quality: signal(UNSCORED),
  } as unknown as Comparison;
  show();
  const said = screen.getByRole("button", { name: /^Stateless followed you 50 ms sooner than Video/ });
  await userEvent.click(said);
  expect(screen.getByRole("region", { name: "The last walk" }).textContent).toContain("Stateless followed you 50 ms");
  expect(said.isConnected).toBe(false);
});

test("a stream whose frames show nothing new says that the server is the limit, and a slow machine that it is", async () => {
  vi.useFakeTimers({ toFake: ["setInterval", "clearInterval", "performance"] });
  settings.value = { ...settings.value, mode: "dash" };
  let ticks = 0;
  const stream = fakeStream({ kind: "playing" });
  stream.status = async () => ({ id: "a", frames: 60 * ticks, repeated: 45 * ticks++, dropped: 0 }) as SessionStatus;
  session.stream.value = stream;
  show();
  for (let i = 0; i < 60; i++) {
    session.rig.sample(performance.now());
    await act(async () => void (await vi.advanceTimersByTimeAsync(100)));
  }
  vi.useRealTimers();
  expect(screen.getByText(/limit, not the link: 75 % of the stream’s frames/)).toBeTruthy();
  expect(screen.getByText("This machine is the limit: its browser draws 10 pictures a second.")).toBeTruthy();
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
  [{ kind: "connecting" }, "Starting the WebRTC stream…"],
  [{ kind: "lost", message: "The stream broke." }, "The stream broke. Trying again…"],
  [{ kind: "failed", message: "This browser cannot." }, "This browser cannot."],
] as const)("a stream that is %j says: %s", (phase, sentence) => {
  settings.value = { ...settings.value, mode: "webrtc" };
  session.stream.value = fakeStream(phase);
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

test("a URL may say where the camera is, and what is shown how", async () => {
  show({ at: "1,2,3,0,0,0,1", mode: "local", drag: "orbit" });
  await act(() => void session.rig.sample(20));
  expect(session.rig.pose.position).toEqual([1, 2, 3]);
  expect(settings.value).toMatchObject({ mode: "local", drag: "orbit" });
});

test("a link to the view is copied, and is the page's address", async () => {
  history.replaceState(null, "", "#/scene/courtyard?stamp");
  settings.value = { ...DEFAULT_SETTINGS, sidebar: true, depth: false };
  const copied: string[] = [];
  vi.stubGlobal("navigator", {
    ...navigator,
    clipboard: { writeText: async (text: string) => void copied.push(text) },
  });
  show();
  await userEvent.click(screen.getByRole("button", { name: "Copy a link to this view" }));
  await screen.findByRole("button", { name: "The link is copied" });
  expect(copied).toEqual([location.href]);
  expect(location.hash).toMatch(/^#\/scene\/courtyard\?at=[-\d.,]+&mode=stateless&depth=off&stamp$/);
  vi.unstubAllGlobals();
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
  [{ mode: "video" }, { mode: "video", left: "stateless", right: "dash-tuned" }],
  [{ right: "video" }, { mode: "side-by-side", left: "stateless", right: "video" }],
  [
    { left: "local-ply", right: "dash-edge" },
    { mode: "side-by-side", left: "local-ply", right: "dash-edge" },
  ],
  [
    { mode: "magic", left: "magic" },
    { mode: "stateless", left: "stateless" },
  ],
])("a URL with %o names what shows the scene, or what is compared", (asked, chosen) => {
  show(asked);
  expect(settings.value).toMatchObject(chosen);
});

test.each([
  [
    { left: "magic" },
    undefined,
    /^The link sets left to “magic”, which does not exist; choose one of stateless, video, /,
  ],
  [
    { prediction: "magic" },
    undefined,
    /^The link names a prediction that does not exist, “magic”; choose one of off, velocity, /,
  ],
  [{ at: "here" }, undefined, /^The link's place cannot be read/],
  [{ profile: "-2" }, undefined, "The link sets profile to “-2”, which it cannot be."],
  [{}, ["predicton"], /^The link names “predicton”, which means nothing here; it may name at, mode, /],
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
