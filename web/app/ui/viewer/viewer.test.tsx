// @vitest-environment happy-dom
import { act, cleanup, render, screen, waitFor } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeAll, beforeEach, expect, test, vi } from "vitest";
import { COURTYARD, serverConfig } from "#fakes/server";
import { type FakeSession, fakeSession, fakeSide, fakeStream } from "#fakes/session";
import { FakeTransport } from "#fakes/transport";
import { screenshot } from "#viewer/control/screenshot";
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
      // biome-ignore lint/correctness/noConstructorReturn: the test's session instead of a connecting one
      return visits.next as object;
    }
  },
}));

let session: FakeSession;

/** Loads the parts that are loaded on demand, so that a busy machine shows them in time. */
beforeAll(async () => {
  const parts = [import("../experiment/experiment-dialog"), import("./side-figures"), import("./help")];
  await Promise.all([...parts, import("./panels"), import("./scripts"), import("./view-menu")]);
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
  expect((await screen.findByRole("alert")).textContent).toBe("The picture could not be saved. The server is busy.");
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
  const drop = async () => {
    const dataTransfer = { types: ["Files"], files: [new File(["nonsense"], "walk.csv")] };
    const event = Object.assign(new Event("drop", { bubbles: true, cancelable: true }), { dataTransfer });
    await act(() => void stage().dispatchEvent(event));
    expect(event.defaultPrevented).toBe(true); // the browser would show the file instead of the page
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
  await user.keyboard("{Enter}"); // on its close button, which is first
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

test("scripts can drive the viewer for as long as it is open", async () => {
  const { unmount } = show();
  await waitFor(() => expect(window.tigas?.state()).toMatchObject({ phase: "playing", mode: "stateless" }));
  unmount();
  await waitFor(() => expect(session.disposed).toBe(true));
  expect(window.tigas).toBeUndefined();
});
