// @vitest-environment happy-dom
import { act, cleanup, render, screen, waitFor } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { turning } from "#viewer/reproject/acceleration";
import { COURTYARD, serverConfig } from "#viewer/state/fake-server";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { config, settings } from "../../state/app";
import { type FakeSession, fakeSession } from "../../state/fake-session";
import type { Asked } from "../../state/route";
import { Viewer } from "./viewer";

vi.mock("../chart/plots", () => ({ plotLive: () => () => undefined, plotDistribution: () => () => undefined }));
const visit = vi.hoisted(() => ({ next: undefined as unknown }));
vi.mock("#viewer/session/session", () => ({
  ViewerSession: class {
    constructor() {
      // biome-ignore lint/correctness/noConstructorReturn: the test's own session in place of one that connects
      return visit.next as object;
    }
  },
}));

let session: FakeSession;

beforeEach(() => {
  turning.value = null;
  settings.value = { ...DEFAULT_SETTINGS, sidebar: false };
  config.value = serverConfig();
  session = fakeSession();
  visit.next = session;
});

afterEach(cleanup);

const show = (asked: Asked = {}) => render(<Viewer sceneId="courtyard" asked={asked} />);

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

test.each([
  ["Gate", 5, null],
  ["Pond", 0, "This scene has no saved view “Pond”."],
  ["constructor", 0, "This scene has no saved view “constructor”."],
])("a URL may name the saved view %s", async (view, x, note) => {
  session.scene.value = { ...COURTYARD, views: { Gate: { position: [5, 0, 0], quaternion: [0, 0, 0, 1] } } };
  settings.value = { ...settings.value, hud: true };
  show({ view });
  await act(() => void session.rig.sample(20));
  expect(session.rig.pose.position[0]).toBeCloseTo(x);
  await waitFor(() => expect(document.querySelector("[data-stat=link-note]")?.textContent ?? null).toBe(note));
});

test("a link to the view is copied, and is the page's address", async () => {
  history.replaceState(null, "", "#/scene/courtyard");
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
  expect(location.hash).toMatch(/^#\/scene\/courtyard\?at=[-\d.,]+&mode=stateless&depth=off$/);
  vi.unstubAllGlobals();
});

test("a URL may say how movement is met, and what makes no sense in it changes nothing", () => {
  show({ reprojection: "off", prediction: "linear" });
  expect(settings.value).toMatchObject({ reprojection: false, prediction: "linear" });
  expect(document.querySelector("[data-stat=link-note]")).toBeNull();
  cleanup();
  show({ reprojection: "maybe", prediction: "magic" });
  expect(settings.value).toMatchObject({ reprojection: false, prediction: "linear" });
  expect(
    screen.getByText("The link sets reprojection to “maybe”, which is not possible; choose one of on, off."),
  ).toBeTruthy();
});

test("a link can insist on reprojection where there is no graphics acceleration", () => {
  turning.value = "slow";
  show({ reprojection: "on" });
  expect(turning.value).toBe("forced");
});

test.each([
  [{ mode: "video" }, { mode: "video", left: "stateless", right: "dash-tuned" }],
  [{ right: "video" }, { mode: "side-by-side", left: "stateless", right: "video" }],
  [
    { left: "local", right: "dash-edge" },
    { mode: "side-by-side", left: "local", right: "dash-edge" },
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
    { left: "local-ply" },
    undefined,
    /^The link sets left to “local-ply”, which is not possible; choose one of stateless, video, /,
  ],
  [
    { prediction: "magic" },
    undefined,
    /^The link sets prediction to “magic”, which is not possible; choose one of off, velocity, /,
  ],
  [{ upscale: "magic" }, undefined, /^The link sets upscale to “magic”, which is not possible; choose one of off, /],
  [{ at: "here" }, undefined, /^The link's place cannot be read/],
  [{ profile: "-2" }, undefined, "The link sets profile to “-2”, which is not possible."],
  [{}, ["predicton"], /^The link has no setting “predicton”; choose from at, view, mode, /],
])("a URL with %o and %o says what makes no sense in it", (asked, unknown, sentence) => {
  render(<Viewer sceneId="courtyard" asked={asked} unknown={unknown} />);
  expect(screen.getByText(sentence)).toBeTruthy();
});
