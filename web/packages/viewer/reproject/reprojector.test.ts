// @vitest-environment happy-dom
import { beforeEach, expect, test, vi } from "vitest";
import { FakeWarp } from "#fakes/warp";
import { orientation } from "../view/camera";
import type { NumberedPose } from "../view/rig";
import { turning } from "./acceleration";
import { type Content, Reprojector, reprojectionNote } from "./reprojector";
import { sideView } from "./side-pictures";
import { resized, viewOfFrame } from "./view";

const LENS = { fx: 640, fy: 640, cx: 640, cy: 360, width: 1280, height: 720 };
const PICTURE = {} as ImageBitmap;

let now: number;
let pane: HTMLElement;
let size: { width: number; height: number };
let reprojector: Reprojector<string>;
let warp: FakeWarp;

beforeEach(() => {
  turning.value = null;
  now = 0;
  vi.spyOn(performance, "now").mockImplementation(() => now++);
  size = { width: 2560, height: 1440 };
  pane = document.createElement("div");
  const below = document.createElement("video");
  pane.append(below);
  reprojector = new Reprojector({
    below,
    size: () => size,
    create: (canvas, options) => {
      warp = new FakeWarp(canvas, options);
      return warp;
    },
  });
  reprojector.on(10);
});

/** A pose that looks `degrees` to the right. */
const pose = (seq: number, degrees = 0): NumberedPose => ({
  seq,
  position: [0, 0, 0],
  quaternion: [...orientation(degrees, 0)],
});

/** A frame of 640×360 requested at a pose, with the given margin at each side. */
function frame(name: string, at: NumberedPose, margin = 0): Content<string> {
  const asked = { ...at, ...LENS };
  const extent = { width: 640 + 2 * margin, height: 360 + 2 * margin, marginX: margin, marginY: margin };
  return { frame: name, pose: at.seq, asked, view: viewOfFrame(asked, extent), depth: null };
}

const canvas = () => pane.querySelector<HTMLCanvasElement>("canvas.reprojected");

/** Takes a frame and draws it for its own pose. */
function show(name: string): void {
  reprojector.take(PICTURE, frame(name, pose(1)));
  reprojector.turn(pose(1), LENS);
}

test("there is no canvas before the first picture is turned, nor once it is off", () => {
  expect(canvas()).toBeNull();
  reprojector.turn(pose(1), LENS);
  expect(canvas()).toBeNull();
  show("a");
  expect(canvas()).toBe(warp.canvas);
  reprojector.off();
  expect([canvas(), warp.disposed, reprojector.status.value, reprojector.working]).toEqual([null, true, "off", false]);
});

test("each animation frame with another view draws the same picture anew, and tells of it once", () => {
  show("a");
  expect(reprojector.presented()).toEqual({ frame: "a", pose: 1, view: 1, filled: 0, warpMs: 2, fresh: true });
  reprojector.turn(pose(2, 5), LENS);
  expect(reprojector.presented()).toMatchObject({ frame: "a", pose: 1, view: 2, fresh: false });
  expect(reprojector.presented()).toBeNull();
  expect([warp.taken.length, warp.drawn.length]).toEqual([1, 2]);
});

test("at rest nothing is drawn, however long", () => {
  reprojector.take(PICTURE, frame("a", pose(1)));
  for (let i = 0; i < 100; i++) reprojector.turn(pose(1), LENS);
  expect(warp.drawn).toHaveLength(1);
  reprojector.turn(pose(1), { ...LENS, fx: 700 });
  size = { width: 1000, height: 562 };
  reprojector.turn(pose(1), { ...LENS, fx: 700 });
  expect(warp.drawn).toHaveLength(3);
});

test("a picture of the very view is shown pixel by pixel, whatever its margins; another fills the screen's pixels", () => {
  reprojector.take(PICTURE, frame("a", pose(1), 64));
  reprojector.turn(pose(1), LENS);
  expect(warp.canvas).toMatchObject({ width: 640, height: 360 });
  expect(warp.drawn.at(-1)).toMatchObject({ fx: 320, cx: 320, width: 640 });
  expect(warp.taken[0]?.view).toMatchObject({ fx: 320, cx: 384, width: 768 });
  reprojector.turn(pose(2, 1), LENS);
  size = { width: 1000, height: 562 };
  reprojector.turn(pose(3, 2), LENS);
  expect(warp.canvas).toMatchObject({ width: 1000, height: 562 });
  expect(warp.drawn.at(-1)).toMatchObject({ fx: 500, cx: 500, width: 1000 });
});

test("the uncovered share is reported, and smaller with margins", () => {
  const filled = (margin: number) => {
    reprojector.take(PICTURE, frame("a", pose(1), margin));
    reprojector.turn(pose(2, 10), LENS);
    return reprojector.presented()?.filled ?? 0;
  };
  const without = filled(0);
  expect(without).toBeGreaterThan(0.1);
  expect(filled(32)).toBeLessThan(without);
  expect(filled(160)).toBe(0);
});

test("across a cut the picture of before stays as it was, and none of before it comes back", () => {
  reprojector.take(PICTURE, frame("before", pose(1)));
  reprojector.turn(pose(1), LENS);
  reprojector.presented();
  reprojector.turn(pose(2, 90), LENS);
  reprojector.take(PICTURE, frame("late", pose(1)));
  reprojector.turn(pose(3, 91), LENS);
  expect([reprojector.presented(), warp.drawn.length, warp.taken.length]).toEqual([null, 1, 1]);
  reprojector.take(PICTURE, frame("after", pose(2, 90)));
  reprojector.turn(pose(4, 92), LENS);
  expect(warp.forgotten).toBe(1);
  expect(reprojector.presented()).toMatchObject({ frame: "after", pose: 2, view: 4 });
});

test("a small step is no cut, measured by the scene's size", () => {
  const stepped = (seq: number, x: number): NumberedPose => ({ ...pose(seq), position: [x, 0, 0] });
  show("a");
  reprojector.turn(stepped(2, 2), LENS);
  expect(warp.drawn).toHaveLength(2);
  reprojector.turn(stepped(3, 6), LENS);
  expect(warp.drawn).toHaveLength(2);
});

test("a picture that changes only in its quality is drawn, and is no new frame", () => {
  show("a");
  reprojector.presented();
  reprojector.take(PICTURE, frame("a, enhanced", pose(1)), false);
  reprojector.turn(pose(1), LENS);
  expect(reprojector.presented()).toMatchObject({ frame: "a, enhanced", fresh: false });
});

test("when the graphics processor is lost, the element below is visible, with the reason", () => {
  show("a");
  warp.lose();
  expect([canvas(), reprojector.working, reprojector.picture()]).toEqual([null, false, null]);
  expect(reprojectionNote(reprojector.status.value)).toContain("was lost");
  reprojector.turn(pose(2, 5), LENS);
  expect(reprojector.presented()).toBeNull();
  warp.restore();
  expect(reprojectionNote(reprojector.status.value)).toBeNull();
  reprojector.take(PICTURE, frame("b", pose(2, 5)));
  reprojector.turn(pose(2, 5), LENS);
  expect(canvas()).not.toBeNull();
});

/** A reprojector in this kind of browser, switched on, over a video. */
function plainly(browser: Partial<ConstructorParameters<typeof Reprojector>[0]>): Reprojector<string> {
  const plain = new Reprojector<string>({
    below: document.createElement("video"),
    size: () => size,
    ...browser,
  });
  plain.on(10);
  return plain;
}

test("a browser without graphics acceleration says so and shows pictures as they come", () => {
  const plain = plainly({
    create: (canvas, options) => Object.assign(new FakeWarp(canvas, options), { working: false }),
  });
  expect([plain.status.value, plain.working]).toEqual(["slow", false]);
  expect(reprojectionNote("slow")).toBe("This browser draws without the graphics processor: smooth turning is off.");
});

test("a browser that gives a video's pictures away to nobody says so and shows them as they come", () => {
  const plain = plainly({ readable: false });
  expect([plain.status.value, plain.working]).toEqual(["unreadable", false]);
  expect(reprojectionNote("on", "unreadable")).toContain("WebCodecs");
  plain.off();
  expect(reprojectionNote(plain.status.value)).toBeNull();
});

test("the main thread's time for a picture and its turn is measured", () => {
  expect(reprojector.warpMs(now)).toBeNull();
  show("a");
  expect(reprojector.warpMs(now)).toBe(2); // one tick of this test's clock for each of the two
  expect(reprojector.gpuMs).toBe(0.5);
});

test.each([
  ["twice as many in a row as the frame has", 1, 1280],
  ["four million", 8, 2731],
])("at most %s pixels are drawn while it turns", (_, scale, width) => {
  size = { width: 7680, height: 4320 };
  const { view, ...rest } = frame("a", pose(1));
  reprojector.take(PICTURE, { ...rest, view: resized(view, 640 * scale, 360 * scale) });
  reprojector.turn(pose(2, 3), LENS);
  expect(warp.canvas.width).toBe(width);
  expect(warp.canvas.width / warp.canvas.height).toBeCloseTo(16 / 9, 2);
});

test("a sharper picture of the same place that comes without depth has the one that is known", () => {
  const depth = { width: 1, height: 1, nearest: 1, codes: Uint8Array.of(7) };
  reprojector.take(PICTURE, { ...frame("a", pose(1), 64), depth });
  reprojector.take(PICTURE, frame("b", pose(1)));
  reprojector.take(PICTURE, frame("c", pose(2, 3)));
  expect(warp.taken.map((one) => one.depth)).toEqual([depth, depth, null]);
});

test("a machine that cannot keep up shows frames as they come in every scene and mode, until someone insists", () => {
  expect(warp.options.accelerated).toBe(true);
  reprojector.take(PICTURE, frame("a", pose(1)));
  for (let i = 1; i <= 4; i++) {
    now += 300;
    reprojector.turn(pose(i, i), LENS);
  }
  expect([reprojector.status.value, reprojector.working, canvas()]).toEqual(["slow", false, null]);
  expect(sessionStorage.getItem("tigas.turning"), "it is remembered across reloads").toBe("slow");
  reprojector.on(10);
  expect(reprojector.status.value).toBe("slow");
  turning.value = "forced";
  reprojector.on(10);
  expect([reprojector.status.value, warp.options.accelerated]).toEqual(["on", false]);
});

const SIDE = sideView(1, [0, 0, 0], [0, -1, 0]);

test("a side of the surround is drawn at once where the frame does not fill the view, and changes nothing where it does", () => {
  show("a");
  reprojector.takeSide(PICTURE, 1, SIDE, 1);
  reprojector.turn(pose(1), LENS);
  expect([warp.sides.length, warp.drawn.length, [...reprojector.surround.keys()]]).toEqual([1, 1, [1]]);
  reprojector.turn(pose(2, 20), LENS);
  reprojector.takeSide(PICTURE, 1, SIDE, 2);
  reprojector.turn(pose(2, 20), LENS);
  expect(warp.drawn.length).toBe(3);
});

test("the surround of before a cut is forgotten, also what comes of it later", () => {
  show("a");
  reprojector.takeSide(PICTURE, 1, SIDE, 1);
  reprojector.turn(pose(2, 90), LENS);
  reprojector.takeSide(PICTURE, 2, SIDE, 1);
  reprojector.take(PICTURE, frame("b", pose(2, 90)));
  expect([reprojector.surround.size, warp.forgotten]).toEqual([0, 1]);
  reprojector.takeSide(PICTURE, 3, SIDE, 1);
  expect(reprojector.surround.size).toBe(0);
  reprojector.takeSide(PICTURE, 3, SIDE, 2);
  expect([...reprojector.surround.keys()]).toEqual([3]);
});

test.each(["off", "lost"])("no surround is left once it is %s", (how) => {
  reprojector.take(PICTURE, frame("a", pose(1)));
  reprojector.takeSide(PICTURE, 1, SIDE, 1);
  if (how === "off") reprojector.off();
  else warp.lose();
  expect(reprojector.surround.size).toBe(0);
});
