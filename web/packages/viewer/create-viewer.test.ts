// @vitest-environment happy-dom

import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import { connect } from "#client/transport/connect";
import { settle } from "#client/transport/fake";
import { createViewer, type Viewer } from "./create-viewer";
import { FakePage } from "./session/fake-page";
import { fetchConfig, loadScene } from "./state/api";
import { COURTYARD, serverConfig } from "./state/fake-server";
import { DEFAULT_SETTINGS } from "./state/settings";

vi.mock("./state/api");
vi.mock("#client/transport/connect");

const POSE = { position: [1, -2, 3], quaternion: [0, 0, 0, 1] } as const;
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
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
});

function open(scene: string, options: Partial<Parameters<typeof createViewer>[1]> = {}): [Viewer, HTMLElement] {
  const container = document.createElement("div");
  const viewer = createViewer(container, { scene, ...options });
  viewers.push(viewer);
  return [viewer, container];
}

test("two viewers on a page have their own scene, server, settings and camera", async () => {
  const [garden, left] = open("garden", { settings: { reprojection: false }, camera: { ...POSE } as never });
  const [hall, right] = open("hall", { server: "https://lab.test/" });
  await settle();
  await host.frames(10);
  expect(vi.mocked(loadScene).mock.calls.map(([scene, , , server]) => [scene, server])).toEqual([
    ["garden", ""],
    ["hall", "https://lab.test"],
  ]);
  expect(
    [left, right].map((container) => container.firstElementChild?.shadowRoot?.querySelectorAll("canvas").length),
  ).toEqual([1, 1]);
  hall.set({ drag: "orbit", refine: false });
  garden.follow((at) => ({ position: [at / 1000, 0, 0], quaternion: [0, 0, 0, 1] }));
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
  hall.follow((at) => ({ position: [at / 1000, 0, 0], quaternion: [0, 0, 0, 1] }));
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
  const [viewer] = open("garden", { camera: { ...POSE } as never });
  const told: string[] = [];
  for (const name of ["loaded", "frame", "stats"] as const) viewer.on(name, () => told.push(name));
  const stop = viewer.on("error", ({ code, message }) => told.push(`${code}: ${message}`));
  await settle();
  await host.frames(30);
  expect(viewer.camera).toEqual(POSE);
  expect(told.indexOf("loaded")).toBeLessThan(told.indexOf("frame"));
  expect(told).toContain("stats");
  viewer.set({ mode: "dash" });
  expect(told.at(-1)).toBe("unavailable: This server has no packager for DASH streams.");
  stop();
  expect(() => viewer.set({ mode: "magic" as never })).toThrow("mode");
  vi.mocked(loadScene).mockRejectedValue(new ApiError("There is no scene attic.", false));
  const [attic] = open("attic");
  attic.on("error", ({ code, message }) => told.push(`${code}: ${message}`));
  await settle();
  expect(told.at(-1)).toBe("failed: There is no scene attic.");
});
