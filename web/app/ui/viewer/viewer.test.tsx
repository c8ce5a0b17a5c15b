// @vitest-environment happy-dom
import { signal } from "@preact/signals";
import { act, cleanup, render, screen, waitFor } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeAll, beforeEach, expect, test, vi } from "vitest";
import type { SessionStatus } from "#client/wire/dash";
import { COURTYARD, serverConfig } from "#fakes/server";
import { type FakeSession, fakeLocal, fakeSession, fakeSide, fakeStream, WALKED_SIDE } from "#fakes/session";
import { FakeTransport } from "#fakes/transport";
import { ComparisonHistory } from "#viewer/charts/history";
import type { Walk } from "#viewer/charts/walk";
import { screenshot } from "#viewer/control/screenshot";
import { type Comparison, UNSCORED } from "#viewer/session/comparison";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { NO_STATS } from "#viewer/stateless/stats";
import { config, settings } from "../../state/app";
import type { Asked } from "../../state/route";
import { save } from "../save";
import { Viewer } from "./viewer";

vi.mock("../chart/plots", () => ({ plotLive: () => () => undefined, plotDistribution: () => () => undefined }));
vi.mock("#viewer/control/screenshot", () => ({ screenshot: vi.fn() }));
vi.mock("../save", async (original) => ({ ...(await original<typeof import("../save")>()), save: vi.fn() }));
const visits = vi.hoisted(() => ({ opened: [] as unknown[][], next: undefined as unknown }));
vi.mock("#viewer/session/session", () => ({
  ViewerSession: class {
    constructor(...options: unknown[]) {
      visits.opened.push(options);
      // biome-ignore lint/correctness/noConstructorReturn: the test's own session in place of one that connects
      return visits.next as object;
    }
  },
}));

let session: FakeSession;

/** The parts that are loaded on demand, so that a busy machine shows them in time. */
beforeAll(async () => {
  const parts = [import("../experiment/experiment-dialog"), import("./side-figures"), import("./help")];
  await Promise.all([...parts, import("./panels"), import("./scripts"), import("./view-menu"), import("./last-walk")]);
});

beforeEach(() => {
  settings.value = { ...DEFAULT_SETTINGS, sidebar: false };
  config.value = serverConfig();
  session = fakeSession();
  visits.opened = [];
  visits.next = session;
});

afterEach(cleanup);

const show = (asked: Asked = {}) => render(<Viewer sceneId="courtyard" asked={asked} />);
const stage = () => screen.getByRole("application");

test("opens the scene, names it, and gives the keys to the stage", () => {
  show();
  expect(visits.opened.map(([scene]) => scene)).toEqual(["courtyard"]);
  expect(document.title).toBe("Courtyard · TIGAS");
  expect(screen.getByRole("heading", { name: "Courtyard", level: 1 })).toBeTruthy();
  expect(document.activeElement).toBe(stage());
});

test("the stage tells scripts how it stands", async () => {
  show();
  await act(() => {
    session.pictures.stats.value = { ...NO_STATS, shown: 4, settled: false };
    session.connected.value = { transport: new FakeTransport(() => 0), fallback: null, host: null };
    session.right.value = fakeSide("right", fakeStream({ kind: "connecting" }));
  });
  expect({ ...stage().dataset }).toEqual({
    phase: "playing",
    transport: "fetch",
    frames: "4",
    settled: "false",
    mode: "stateless",
    sources: "playing connecting",
    shown: "4 0",
  });
});

test("keys open help, hide the measurements, open the settings and change the mode", async () => {
  const user = userEvent.setup();
  settings.value = { ...settings.value, hudDetails: true };
  show();
  await user.keyboard("h");
  expect(await screen.findByRole("dialog", { name: "Getting around" })).toHaveProperty("open", true);
  await user.keyboard("h");
  await waitFor(() => expect(screen.queryByRole("dialog")).toBeNull());
  expect(document.activeElement).toBe(stage());
  await screen.findByRole("region", { name: "Measurements" });
  await user.keyboard("i");
  expect(screen.queryByRole("region", { name: "Measurements" })).toBeNull();
  await user.keyboard("i");
  expect(screen.getByRole("region", { name: "Measurements" })).toBeTruthy();
  await user.keyboard("p");
  expect(screen.getByRole("complementary", { name: "Lab" })).toBeTruthy();
  const modes: string[] = [];
  for (let i = 0; i < 5; i++) {
    await user.keyboard("m");
    modes.push(settings.value.mode);
  }
  expect(modes).toEqual(["video", "dash", "webrtc", "local", "side-by-side"]);
});

test("T and a button save a picture of the view, or say why not", async () => {
  const picture = new Blob(["png"]);
  vi.mocked(screenshot).mockResolvedValueOnce(picture);
  show();
  await userEvent.keyboard("t");
  await waitFor(() => expect(save).toHaveBeenCalledWith("Courtyard.png", picture));
  vi.mocked(screenshot).mockRejectedValueOnce(new Error("The server is busy."));
  await userEvent.click(screen.getByRole("button", { name: "Save a picture" }));
  expect((await screen.findByRole("alert")).textContent).toBe("The picture was not saved. The server is busy.");
});

test("without controls there is only the view", async () => {
  settings.value = { ...settings.value, sidebar: true };
  render(<Viewer sceneId="courtyard" asked={{}} bare />);
  await userEvent.keyboard("h");
  expect(stage()).toBeTruthy();
  for (const role of ["banner", "dialog", "complementary", "region", "link"]) {
    expect(screen.queryByRole(role)).toBeNull();
  }
});

test("a dropped file is a movement, but not in a view without controls", async () => {
  const drop = () => {
    const dataTransfer = { types: ["Files"], files: [new File(["nonsense"], "walk.csv")] };
    const event = Object.assign(new Event("drop", { bubbles: true, cancelable: true }), { dataTransfer });
    return act(() => void stage().dispatchEvent(event));
  };
  const { rerender } = render(<Viewer sceneId="courtyard" asked={{}} bare />);
  await act(() => vi.dynamicImportSettled());
  await drop();
  expect(settings.value.sidebar).toBe(false);
  rerender(<Viewer sceneId="courtyard" asked={{}} />);
  await act(() => vi.dynamicImportSettled());
  await drop();
  expect(settings.value.sidebar).toBe(true);
  await waitFor(() => expect(session.movement.problem.value).toContain("walk.csv"));
});

test("help names the keys as the keyboard in use does", async () => {
  const layout = new Map([
    ["KeyW", "z"],
    ["KeyA", "q"],
  ]);
  vi.stubGlobal(
    "navigator",
    Object.assign(Object.create(navigator), { keyboard: { getLayoutMap: async () => layout } }),
  );
  show();
  await userEvent.keyboard("h");
  const walk = (await screen.findByText("Walk")).parentElement;
  await waitFor(() => expect(walk?.textContent).toBe("WalkZQSD"));
});

test.each([
  [{ reprojection: true, prediction: "linear" }, "on", true],
  [{ reprojection: false, prediction: "linear" }, "off", false],
  [{ reprojection: true, prediction: "linear" }, "slow", false],
] as const)("an experiment begins with the viewer's own settings: %o, turning %s", async (chosen, status, checked) => {
  settings.value = { ...settings.value, ...chosen };
  session.pictures.reprojection.value = status;
  config.value = serverConfig({ store: "http://store.test" });
  vi.stubGlobal("fetch", async () => Response.json({ movements: [] }));
  show();
  await userEvent.keyboard("x");
  expect((await screen.findByRole<HTMLInputElement>("checkbox", { name: "Reprojection" })).checked).toBe(checked);
  expect(screen.getByRole<HTMLSelectElement>("combobox", { name: "Prediction" }).value).toBe("linear");
});

test("a dialog gives the focus back to its button, and the settings give it to the stage", async () => {
  const user = userEvent.setup();
  show();
  const help = screen.getByRole("button", { name: "Help" });
  help.focus();
  await user.keyboard("{Enter}");
  await screen.findByRole("dialog");
  await user.keyboard("{Enter}"); // on its button to close it, which is first
  await waitFor(() => expect(screen.queryByRole("dialog")).toBeNull());
  expect(document.activeElement).toBe(help);
  await user.keyboard("p");
  expect(document.activeElement).toBe(help);
  screen.getByRole("button", { name: "Close lab" }).focus();
  await user.keyboard("{Enter}");
  expect(document.activeElement).toBe(stage());
});

test("fullscreen leaves the settings away until they are asked for, and gives them back at its end", async () => {
  settings.value = { ...DEFAULT_SETTINGS, sidebar: true };
  show();
  const shown = () => screen.queryByRole("complementary", { name: "Lab" }) !== null;
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
      session.pictures.stats.value = { ...NO_STATS, frozenFor };
    });
    return document.querySelector("[data-stat=frozen]")?.textContent;
  };
  expect(await freeze(600)).toBeUndefined();
  expect(await freeze(2300)).toBe("Frozen, no new picture for 2.3 s");
  await act(() => {
    session.phase.value = { kind: "lost", message: "QUIC did not answer in time." };
  });
  expect(document.querySelector("[data-stat=frozen]"), "the message of a lost stream is enough").toBeNull();
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

test("typing into a field, or with a modifier, is no shortcut", async () => {
  const user = userEvent.setup();
  settings.value = { ...DEFAULT_SETTINGS, sidebar: true };
  show();
  await user.type(await screen.findByRole("spinbutton", { name: /Turn/ }), "i");
  stage().focus();
  await user.keyboard("{Control>}i{/Control}");
  expect(settings.value.hud).toBe(true);
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
  expect((await screen.findByRole("region", { name: "The last walk" })).textContent).toContain("Stateless was 50 ms");
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
  expect(screen.getByText("This computer is slow: it shows only 10 pictures per second.")).toBeTruthy();
});

test.each([
  [{ kind: "connecting" }, "Connecting…"],
  [{ kind: "loading" }, "Loading the scene…"],
  [{ kind: "lost", message: "The server does not answer." }, "The server does not answer. Trying again…"],
  [{ kind: "full" }, "The server is full. The scene opens automatically as soon as there is room."],
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

test("a scene that there is not has nothing to set, to measure or to walk in", async () => {
  settings.value = { ...DEFAULT_SETTINGS, sidebar: true };
  session.phase.value = { kind: "failed", message: "There is no scene courtyard." };
  const { container } = show();
  expect(screen.queryByRole("group", { name: "Tools" })).toBeNull();
  expect(screen.queryByRole("complementary", { name: "Lab" })).toBeNull();
  expect(container.querySelector(".move-pad")).toBeNull();
  expect(screen.getByRole("link", { name: "Back to all scenes" })).toBeTruthy();
  await userEvent.keyboard("ip");
  expect(settings.value, "no shortcut changes hidden things").toMatchObject({ hud: true, sidebar: true });
  await act(() => {
    session.phase.value = { kind: "playing" };
  });
  expect(screen.getByRole("group", { name: "Tools" })).toBeTruthy();
});

test("fullscreen is offered only where the browser has it", () => {
  show();
  expect(screen.queryByRole("button", { name: "Fullscreen" })).toBeNull();
  cleanup();
  Object.assign(document, { fullscreenEnabled: true });
  show();
  expect(screen.getByRole("button", { name: "Fullscreen" })).toBeTruthy();
  Reflect.deleteProperty(document, "fullscreenEnabled");
});

test("from the settings, keys get back to the view in one step", async () => {
  settings.value = { ...DEFAULT_SETTINGS, sidebar: true };
  show();
  screen.getByRole("button", { name: "Skip to the view" }).focus();
  await userEvent.keyboard("{Enter}");
  expect(document.activeElement).toBe(stage());
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
    session.phase.value = { kind: "lost", message: "The server does not answer." };
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

test("a visitor chooses the picture, its quality and dragging in plain words", async () => {
  const user = userEvent.setup();
  config.value = serverConfig({ dash: "http://dash.test" });
  session.scene.value = { ...COURTYARD, downloads: [{ form: "compressed", bytes: 1_000_000 }] };
  show();
  await user.click(screen.getByRole("button", { name: "View" }));
  await screen.findByRole("radio", { name: "Stream" });
  const choose = (name: string) => user.click(screen.getByRole("radio", { name }));
  const checked = () =>
    screen.getAllByRole<HTMLInputElement>("radio", { checked: true }).map((radio) => radio.parentElement?.textContent);
  expect(checked()).toEqual(["Stream", "Auto", "Look around", "System"]);
  await choose("Sharp");
  expect(settings.value).toMatchObject({ controller: "fixed", profile: 0 });
  await choose("Fast");
  expect(settings.value).toMatchObject({ controller: "fixed", profile: 2 });
  await choose("Orbit");
  expect(settings.value.drag).toBe("orbit");
  await choose("Compare");
  expect(settings.value.mode).toBe("side-by-side");
  await act(() => {
    settings.value = { ...settings.value, mode: "webrtc" };
  });
  expect(checked()[0]).toBe("Stream");
  await choose("On this device");
  expect(settings.value.mode).toBe("local");
  await user.keyboard("{Escape}");
  expect(screen.queryByRole("radio")).toBeNull();
});

test("visitors see no modes that the server lacks", async () => {
  show();
  await userEvent.click(screen.getByRole("button", { name: "View" }));
  expect(await screen.findByRole("radio", { name: "Stream" })).toBeTruthy();
  expect(screen.queryByRole("radio", { name: "Compare" })).toBeNull();
  expect(screen.queryByRole("radio", { name: "On this device" })).toBeNull();
});

test("single-key shortcuts can be switched off", async () => {
  const user = userEvent.setup();
  show();
  await user.keyboard("h");
  await user.click(await screen.findByRole("checkbox", { name: "Single-key shortcuts" }));
  await user.keyboard("{Escape}");
  await user.keyboard("m");
  expect(settings.value).toMatchObject({ shortcuts: false, mode: "stateless" });
  expect(screen.getByRole("button", { name: "Help" }).title).toBe("Help");
});

test.each([
  [{ kind: "connecting", message: "Starting the WebRTC stream…" }, "Starting the WebRTC stream…"],
  [{ kind: "lost", message: "The stream broke." }, "The stream broke. Trying again…"],
  [{ kind: "failed", message: "This browser cannot." }, "This browser cannot."],
  [{ kind: "playing", problem: "The server has no memory left." }, "The server has no memory left."],
] as const)("a picture that is %j says: %s", (phase, sentence) => {
  session.pictures.phase.value = phase;
  show();
  expect(screen.getByText(sentence)).toBeTruthy();
});

test("scripts can drive the viewer for as long as it is open", async () => {
  const { unmount } = show();
  await waitFor(() => expect(window.tigas?.state()).toMatchObject({ phase: "playing", mode: "stateless" }));
  unmount();
  await waitFor(() => expect(session.disposed).toBe(true));
  expect(window.tigas).toBeUndefined();
});

test("the status of enhancement is shown", async () => {
  show();
  await act(() => {
    session.pictures.enhancement.status.value = { kind: "starting", message: null };
  });
  expect(document.querySelector("[data-stat=enhancement-note]")).toBeNull();
  await act(() => {
    session.pictures.enhancement.status.value = { kind: "failed", message: "It took 40 ms a frame." };
  });
  expect(screen.getByText("Enhancement is off. It took 40 ms a frame.")).toBeTruthy();
});
