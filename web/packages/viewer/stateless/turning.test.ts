import { beforeEach, expect, test, vi } from "vitest";
import { PlayerBench } from "#fakes/player-bench";
import { STILL } from "#fakes/rig";
import { Display } from "../enhance/display";
import { angleBetween } from "../view/vector";

let bench: PlayerBench;

beforeEach(() => {
  bench = new PlayerBench();
  bench.reprojector.on(10);
});

test("a turn is seen in the next animation frame, and the pixels are as old as they are", async () => {
  await bench.frames(10);
  bench.presented = [];
  bench.axes = { ...STILL, turnRight: 1 };
  await bench.frames(12, { answer: false });
  expect(bench.presented).toHaveLength(11);
  for (const one of bench.presented) {
    expect(one.latencies).toEqual([expect.closeTo(1000 / 60, 3)]);
    expect(one.view).toBeGreaterThan(one.pose);
  }
  expect(new Set(bench.presented.map(({ pose }) => pose)).size).toBe(1);
  await bench.frames(30, { answer: false });
  expect(bench.player.stats.value.motionToPhoton?.p50).toBeCloseTo(1000 / 60, 1);
  expect(bench.player.stats.value.contentAge).toBeGreaterThan(200);
  expect(bench.player.stats.value).toMatchObject({ turned: true, shown: 1, newViewsPerSecond: 0 });
});

test("asks for where the camera will be, and draws where it will be when that is seen: one animation frame later", async () => {
  bench.prediction = "velocity";
  await bench.frames(3);
  bench.axes = { ...STILL, turnRight: 1 };
  await bench.frames(20);
  expect(angleBetween(bench.rig.pose.quaternion, bench.last()?.quaternion ?? [0, 0, 0, 1])).toBeCloseTo(2.5, 2);
  expect(angleBetween(bench.rig.pose.quaternion, bench.warp.drawn.at(-1)?.quaternion ?? [0, 0, 0, 1])).toBeCloseTo(
    1,
    2,
  );
  bench.axes = STILL;
  await bench.frames(20);
  expect(bench.warp.drawn.at(-1)?.quaternion).toEqual(bench.rig.pose.quaternion);
});

test("only new frames count as frames, and as an end of a stall", async () => {
  await bench.frames(10);
  bench.axes = { ...STILL, turnRight: 1 };
  await bench.frames(20);
  await bench.frames(30, { answer: false });
  await bench.frames(20);
  expect(bench.player.stats.value.stalls.count).toBe(1);
  expect(bench.presented.length).toBeGreaterThan(50);
});

test("at rest the frame itself is shown, and nothing is drawn", async () => {
  bench.axes = { ...STILL, turnRight: 1 };
  await bench.frames(20);
  bench.axes = STILL;
  await bench.frames(40);
  const draws = bench.warp.drawn.length;
  await bench.frames(100);
  expect(bench.warp.drawn).toHaveLength(draws);
  expect(bench.last()).not.toHaveProperty("overscan");
  expect(bench.presented.at(-1)).toMatchObject({ view: bench.rig.pose.seq, pose: bench.rig.pose.seq, filled: 0 });
});

test("asks for margins and for depth as it is set", async () => {
  bench.overscan = 0.2;
  await bench.frames(5);
  expect(bench.last()).toMatchObject({ overscan: 0.2, depth: true });
  bench.depth = false;
  await bench.frames(5);
  expect(bench.last()).not.toHaveProperty("depth");
  bench.reprojector.off();
  bench.depth = true;
  await bench.frames(5);
  expect(bench.last()).not.toHaveProperty("overscan");
  expect(bench.last()).not.toHaveProperty("depth");
});

test("margins of enhanced frames come in few sizes", async () => {
  vi.spyOn(Display.prototype, "enhances", "get").mockReturnValue(true);
  bench.axes = { ...STILL, turnRight: 1 };
  await bench.frames(10);
  await bench.frames(20, { answer: false });
  await bench.frames(20);
  vi.restoreAllMocks();
  const margins = new Set(bench.transport.requests.map(({ request }) => request.overscan ?? 0));
  expect([...margins].filter((margin) => ![0, 0.125, 0.25].includes(margin))).toEqual([]);
  expect(margins.size).toBeGreaterThan(1);
});

test("margins of the frame that came are what counts, not those that are asked for by now", async () => {
  bench.overscan = 0.25;
  await bench.frames(1);
  bench.overscan = 0;
  await bench.frames(4);
  const [first] = bench.warp.taken;
  const { fx } = bench.rig.intrinsics.value;
  expect(first?.view).toMatchObject({ width: 1280, cx: 640, fx: expect.closeTo(fx / 1.5) });
  expect(bench.warp.taken.at(-1)?.view).toMatchObject({ width: 1280, cx: 640, fx: expect.closeTo(fx) });
});

test.each([30, 120])(
  "a display of %i Hz shows a turn in the next animation frame, drawn for when it is seen",
  async (rate) => {
    bench.rate = rate;
    bench.prediction = "velocity";
    await bench.frames(10);
    bench.presented = [];
    bench.axes = { ...STILL, turnRight: 1 };
    await bench.frames(rate);
    expect(bench.presented.length).toBeGreaterThan(rate - 2);
    for (const { latencies } of bench.presented) expect(latencies).toEqual([expect.closeTo(1000 / rate, 3)]);
    const ahead = bench.warp.drawn.at(-1)?.quaternion ?? [0, 0, 0, 1];
    expect(angleBetween(bench.rig.pose.quaternion, ahead)).toBeCloseTo(60 / rate, 2);
  },
);

test("a phone that is rotated in the midst of a turn goes on turning what it has, and asks for no wider margins", async () => {
  const margins = () => bench.transport.requests.slice(-10).map(({ request }) => request.overscan ?? 0);
  bench.axes = { ...STILL, turnRight: 1 };
  await bench.frames(60);
  const before = Math.max(...margins());
  const draws = bench.warp.drawn.length;
  bench.resize(720, 1280);
  await bench.frames(5, { answer: false });
  expect(bench.warp.drawn.length).toBe(draws + 5);
  expect(bench.warp.drawn.at(-1)).toMatchObject({ width: 720, height: 1280, cx: 360, cy: 640 });
  await bench.frames(20);
  expect(bench.last()).toMatchObject({ width: 720, height: 1280 });
  expect(Math.max(...margins())).toBeLessThanOrEqual(before + 0.05);
});
