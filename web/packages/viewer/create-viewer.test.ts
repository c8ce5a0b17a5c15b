// @vitest-environment happy-dom

import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import { connect } from "#client/transport/connect";
import { FakePage } from "#fakes/page";
import { COURTYARD, serverConfig } from "#fakes/server";
import { settle } from "#fakes/transport";
import { createViewer, type Viewer } from "./create-viewer";
import { fetchConfig, loadScene } from "./state/api";
import { DEFAULT_SETTINGS } from "./state/settings";
import type { ScenePose } from "./view/camera";

vi.mock("./state/api");
vi.mock("#client/transport/connect");

const POSE: ScenePose = { position: [1, -2, 3], quaternion: [0, 0, 0, 1] };
const AWAY: ScenePose = { position: [5, -2, 3], quaternion: [0, 1, 0, 0] };
let host: FakePage;
let viewers: Viewer[];

beforeEach(() => {
  host = new FakePage();
  viewers = [];
  vi.mocked(fetchConfig).mockImplementation(async () => serverConfig());
  vi.mocked(loadScene).mockImplementation(async (id) => ({ ...COURTYARD, id, name: id }));
  vi.mocked(connect).mockImplementation(async () => host.connected());
});

afterEach(() => {
  for (const viewer of viewers) viewer.destroy();
  vi.restoreAllMocks();
});

const press = (stage: HTMLElement, code: string) =>
  void stage.dispatchEvent(new KeyboardEvent("keydown", { code, key: code }));

function open(scene: string, options: Partial<Parameters<typeof createViewer>[1]> = {}): [Viewer, HTMLElement] {
  const container = document.createElement("div");
  const viewer = createViewer(container, { scene, ...options });
  viewers.push(viewer);
  return [viewer, container];
}

test("two viewers on a page have their own scene, server, settings and camera", async () => {
  const [garden, left] = open("garden", { settings: { reprojection: false }, camera: POSE });
  const [hall, right] = open("hall", { server: "https://lab.test/" });
  await settle();
  await host.frames(10);
  expect(new Map(vi.mocked(loadScene).mock.calls.map(([scene, , options]) => [scene, options?.server]))).toEqual(
    new Map([
      ["garden", ""],
      ["hall", "https://lab.test"],
    ]),
  );
  expect(
    [left, right].map((container) => container.firstElementChild?.shadowRoot?.querySelectorAll("canvas").length),
  ).toEqual([1, 1]);
  hall.set({ drag: "orbit", refine: false });
  void garden.animate(AWAY);
  await host.frames(5);
  expect([garden.settings, hall.settings]).toEqual([
    { ...DEFAULT_SETTINGS, reprojection: false },
    { ...DEFAULT_SETTINGS, drag: "orbit", refine: false },
  ]);
  expect(garden.camera.position[0]).toBeGreaterThan(0);
  expect(hall.camera.position).toEqual([0, -2, -8]);
  const asked = host.requests();
  expect(new Set(asked.map(({ scene }) => scene))).toEqual(new Set(["garden", "hall"]));
  garden.destroy();
  expect(left.childElementCount).toBe(0);
  void hall.animate(AWAY);
  await host.frames(5);
  expect(
    new Set(
      host
        .requests()
        .slice(asked.length)
        .map(({ scene }) => scene),
    ),
  ).toEqual(new Set(["hall"]));
});

test("tells that the scene is there, of each frame, of figures and of errors by code", async () => {
  const [viewer] = open("garden", { camera: POSE });
  const told: string[] = [];
  for (const name of ["loaded", "frame", "stats"] as const) viewer.on(name, () => told.push(name));
  const stop = viewer.on("error", ({ code, message }) => told.push(`${code}: ${message}`));
  await settle();
  await host.frames(30);
  expect(viewer.camera).toEqual(POSE);
  expect(told.indexOf("loaded")).toBeLessThan(told.indexOf("frame"));
  expect(told).toContain("stats");
  viewer.set({ mode: "dash" });
  expect(told.at(-1)).toBe("unavailable: This server does not offer DASH streams.");
  stop();
  expect(() => viewer.set({ mode: "magic" as never })).toThrow("mode");
  expect(() => viewer.set({ mod: "video" } as never)).toThrow("unknown setting mod");
  vi.mocked(loadScene).mockRejectedValue(new ApiError("There is no scene attic.", false));
  const [attic] = open("attic");
  attic.on("error", ({ code, message }) => told.push(`${code}: ${message}`));
  await settle();
  expect(told.at(-1)).toBe("failed: There is no scene attic.");
});

test("a reset before the scene is loaded forgets the camera to begin with, and a picture awaits a frame", async () => {
  const [viewer] = open("garden", { camera: POSE });
  viewer.reset();
  expect(viewer.picture()).toBeNull();
  await settle();
  await host.frames(2);
  expect(viewer.camera).not.toEqual(POSE);
  viewer.camera = POSE;
  expect(viewer.camera).toEqual(POSE);
});

test("an animation resolves when the camera is there, and the user continues from there", async () => {
  const [viewer] = open("garden", { camera: POSE });
  await settle();
  await host.frames(2);
  const arrived = vi.fn();
  void viewer.animate(AWAY, { duration: 400, easing: "linear" }).then(arrived);
  await host.frames(11);
  expect(arrived).not.toHaveBeenCalled();
  expect(viewer.camera.position[0]).toBeCloseTo(3);
  await host.frames(11);
  expect(arrived).toHaveBeenCalledWith(true);
  await host.frames(5);
  expect(viewer.camera.position).toEqual(AWAY.position);
});

test("a viewer outside the window asks for nothing", async () => {
  let see = (_: readonly { readonly isIntersecting: boolean }[]) => {};
  const observed = class {
    constructor(tell: typeof see) {
      see = tell;
    }
    observe(): void {}
    disconnect(): void {}
  };
  vi.stubGlobal("IntersectionObserver", observed);
  const [viewer] = open("garden", { camera: POSE });
  await settle();
  await host.frames(5);
  const before = host.requests().length;
  see([{ isIntersecting: false }]);
  viewer.camera = AWAY;
  await host.frames(20);
  expect(host.requests()).toHaveLength(before);
  see([{ isIntersecting: true }]);
  await host.frames(5);
  expect(host.requests().at(-1)).toMatchObject({ position: [5, -2, 3] });
});

test("an unknown easing is refused, and the viewer goes on", async () => {
  const [viewer] = open("garden", { camera: POSE });
  await settle();
  expect(() => viewer.animate(AWAY, { easing: "smooth" as never })).toThrow("Unknown easing “smooth”: use linear,");
  await host.frames(2);
  expect(viewer.camera).toEqual(POSE);
});

test("a server's relative URL counts from the page's", async () => {
  open("garden", { server: "/tigas/" });
  await settle();
  expect(vi.mocked(loadScene).mock.lastCall?.[2]?.server).toBe(new URL("/tigas", document.baseURI).href);
});

test.each<[string, (viewer: Viewer, stage: HTMLElement) => void]>([
  ["another animation", (viewer) => void viewer.animate(POSE)],
  ["a new camera", (viewer) => Object.assign(viewer, { camera: POSE })],
  ["a press on the picture", (_, stage) => void stage.dispatchEvent(new Event("pointerdown"))],
  ["a key that moves", (_, stage) => press(stage, "KeyW")],
  ["Escape", (_, stage) => press(stage, "Escape")],
  ["the viewer's end", (viewer) => viewer.destroy()],
])("%s ends a looped path, where the camera is", async (_, end) => {
  const [viewer, container] = open("garden", { camera: POSE });
  const stage = container.firstElementChild?.shadowRoot?.querySelector<HTMLElement>(".stage");
  await settle();
  await host.frames(2);
  const keyframes = [
    { t_ms: 0, ...POSE },
    { t_ms: 400, ...AWAY },
  ];
  const ended = viewer.path(keyframes, { loop: true });
  await host.frames(31);
  if (stage) press(stage, "KeyT"); // moves nothing
  expect(viewer.camera.position[0]).toBeCloseTo(3); // halfway for the second time
  if (stage) end(viewer, stage);
  await host.frames(1);
  await expect(ended).resolves.toBe(false);
});
