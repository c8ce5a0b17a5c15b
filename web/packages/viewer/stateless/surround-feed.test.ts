import { beforeEach, expect, test } from "vitest";
import { PlayerBench } from "#fakes/player-bench";

let bench: PlayerBench;
let received: number;

beforeEach(() => {
  bench = new PlayerBench();
  bench.surround = true;
  received = 0;
});

const sides = () => bench.transport.requests.filter(({ request }) => request.width === request.height);

test("small pictures of all directions come once the first view is on the screen, and nothing hears of them but the throughput", async () => {
  bench.reprojector.on(8);
  bench.observed = () => received++;
  await bench.frames(1, { answer: false });
  await bench.frames(2, { answer: false });
  expect(sides()).toHaveLength(0);
  await bench.frames(120);
  expect(sides()).toHaveLength(6);
  expect(new Set(sides().map(({ request }) => request.profile))).toEqual(new Set([3]));
  expect([bench.warp.sides.length, received, bench.replies.length]).toEqual([6, 1, 1]);
  expect(bench.player.stats.value).toMatchObject({ settled: true, frame: { width: 1280 }, counts: { sent: 1 } });
  expect(new Set(bench.transport.requests.map(({ request }) => request.seq)).size).toBe(7);
});

test("a view that rests gets sharper once all directions have come", async () => {
  bench.refine = true;
  bench.profile = 3;
  bench.reprojector.on(8);
  await bench.frames(120);
  const order = bench.transport.requests.map(({ request: { width, height, profile } }) =>
    width === height ? "side" : profile === undefined ? "sharper" : "view",
  );
  expect(order.slice(0, 8)).toEqual(["view", ...Array(6).fill("side"), "sharper"]);
});

test.each(["off", "without reprojection"])("asks for nothing besides: %s", async (how) => {
  if (how === "off") {
    bench.surround = false;
    bench.reprojector.on(8);
  }
  await bench.frames(120);
  expect(bench.transport.requests).toHaveLength(1);
});

test("another connection begins where the last one ended", async () => {
  bench.reprojector.on(8);
  await bench.frames(10, { answer: false });
  for (const { reply } of bench.transport.requests) reply();
  await bench.frames(3, { answer: false });
  expect(sides()).toHaveLength(1);
  bench.connect();
  await bench.frames(120);
  expect([sides().length, bench.warp.sides.length]).toEqual([6, 6]);
});
