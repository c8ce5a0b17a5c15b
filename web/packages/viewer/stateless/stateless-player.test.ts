import { beforeEach, describe, expect, test } from "vitest";
import { PlayerBench } from "#fakes/player-bench";
import { STILL } from "#fakes/rig";
import type { Display } from "../enhance/display";
import { angleBetween } from "../view/vector";
import type { DecodedFrame } from "./pipeline";
import type { Reply } from "./stateless-player";

let bench: PlayerBench;

beforeEach(() => {
  bench = new PlayerBench();
});

test("tells of each frame on the screen what was asked for and what came, one animation frame later", async () => {
  await bench.frames(2);
  expect([bench.shown, bench.drawn]).toEqual([[], [expect.anything()]]);
  await bench.frames(1);
  const [asked] = bench.transport.requests.map(({ request }) => request);
  expect(bench.shown).toEqual([
    { at: bench.now, asked, header: expect.objectContaining({ seq: 0 }), image: expect.any(Blob), enhanced: null },
  ]);
  expect(asked).toMatchObject({ seq: 0, scene: "courtyard", width: 1280 });
  await bench.frames(2);
  expect(bench.shown).toHaveLength(1);
});

test("enters at the scene's start camera, with the stage's own lens", async () => {
  await bench.frames(1);
  expect(bench.last()).toMatchObject({ scene: "courtyard", position: [0, -2, -8], quaternion: [0, 0, 0, 1] });
  expect(bench.last()).toMatchObject({ width: 1280, height: 720, cx: 640, cy: 360, profile: 0 });
  expect(bench.rig.moveSpeed.value).toBe(2);
});

test("a still camera asks for one frame and no more", async () => {
  await bench.frames(200);
  expect(bench.transport.requests).toHaveLength(1);
  expect(bench.drawn).toHaveLength(1);
  expect(bench.player.stats.value).toMatchObject({ settled: true, shown: 1 });
});

test("walking asks for the views along the way, and for the last one for sure", async () => {
  await bench.frames(3);
  bench.axes = { ...STILL, forward: 1 };
  await bench.frames(30);
  bench.axes = STILL;
  await bench.frames(30);
  expect(bench.last()?.position?.[2]).toBeCloseTo(-8 + 2 * 0.5, 1);
  expect(bench.player.stats.value.settled).toBe(true);
});

test("of a bit rate that is given no more is asked for than fits into it, and the last view all the same", async () => {
  bench.bitrateKbps = 80; // ten frames of 1000 bytes per second
  await bench.frames(3);
  bench.axes = { ...STILL, turnRight: 1 };
  const before = bench.transport.requests.length;
  await bench.frames(180);
  const asked = bench.transport.requests.length - before;
  expect(asked).toBeGreaterThan(27);
  expect(asked).toBeLessThan(34);
  bench.axes = STILL;
  await bench.frames(30);
  expect(bench.last()?.quaternion).toEqual(bench.rig.pose.quaternion);
});

test("motion-to-photon counts from the sample to the animation frame after the drawing", async () => {
  await bench.frames(2);
  bench.axes = { ...STILL, turnRight: 1 };
  await bench.frames(1, { answer: false }); // sampled and sent
  bench.axes = STILL;
  await bench.frames(2); // 17 ms later it is answered, then drawn
  await bench.frames(20); // and on the screen in the animation frame after that
  expect(bench.player.stats.value.motionToPhoton?.p50).toBeCloseTo(3 * (1000 / 60), 3);
});

test("an enhanced frame is on the screen when the display says so: its time is in motion-to-photon", async () => {
  const making: DecodedFrame[] = [];
  const enhanced = {
    width: 1280,
    height: 720,
    ms: 40,
    restore: "off",
    upscale: "scene",
    copy: () => ({}) as ImageBitmap,
  };
  let age = 0;
  const display = {
    get ready() {
      return making.length === 0;
    },
    get settled() {
      return making.length === 0;
    },
    show: (frame: DecodedFrame) => making.push(frame),
    // Each frame takes three animation frames.
    presented: () => {
      if (making.length === 0 || ++age < 3) return null;
      age = 0;
      return { frame: making.shift() as DecodedFrame, enhanced };
    },
    forget: () => undefined,
  };
  bench = new PlayerBench(display as unknown as Display<DecodedFrame>);
  await bench.frames(6);
  bench.axes = { ...STILL, turnRight: 1 };
  await bench.frames(1, { answer: false });
  bench.axes = STILL;
  await bench.frames(2);
  expect(bench.player.stats.value.settled).toBe(false);
  await bench.frames(20);
  expect(bench.player.stats.value.motionToPhoton?.p50).toBeCloseTo(5 * (1000 / 60), 3);
  expect(bench.player.stats.value).toMatchObject({ settled: true, enhanceMs: 40, shown: 2 });
  expect(bench.presented.at(-1)).toMatchObject({ shownWidth: 1280, shownHeight: 720, enhanceMs: 40 });
  expect(bench.shown.at(-1)).toMatchObject({ enhanced: { upscale: "scene" } });
});

describe("refining", () => {
  const asked = () => bench.transport.requests.map(({ request: { profile, width } }) => [profile, width]);

  test("asks for the screen's own pixels once the camera stands still, and for the rung when it moves again", async () => {
    bench.profile = 3;
    bench.refine = true;
    await bench.frames(40);
    expect(asked()).toEqual([
      [3, 1280],
      [undefined, 2560],
    ]);
    expect(bench.last()).toMatchObject({ height: 1440, cx: 1280, cy: 720 });
    bench.axes = { ...STILL, forward: 1 };
    await bench.frames(2);
    expect(bench.last()).toMatchObject({ profile: 3, width: 1280 });
  });

  test("is not heard of by the controller", async () => {
    const heard: unknown[] = [];
    bench.observed = (observation) => heard.push(observation.profile);
    bench.profile = 3;
    bench.refine = true;
    await bench.frames(40);
    expect(bench.replies.map(({ asked }) => asked)).toEqual([3, null]);
    expect(heard).toEqual([3]);
  });

  test("the view is settled when it is as sharp as it gets", async () => {
    bench.refine = true;
    await bench.frames(8);
    expect(bench.shown).toHaveLength(1);
    expect(bench.player.stats.value.settled).toBe(false);
    await bench.frames(40);
    expect(bench.player.stats.value.settled).toBe(true);
  });

  test("a step that fails leaves what is shown, and is not tried again before the camera moves", async () => {
    bench.refine = true;
    bench.profile = 3;
    await bench.frames(3);
    while (bench.transport.requests.length < 2) await bench.frames(1, { answer: false });
    bench.transport.requests[1]?.fail(new Error("too large"));
    await bench.frames(100);
    expect(asked().map(([rung]) => rung)).toEqual([3, undefined, 3]);
    expect(bench.player.stats.value.settled).toBe(true);
    expect(bench.player.problem.value).toBeNull();
  });
});

test("tells of each reply: when it came, of which pose, and the rung that was asked for", async () => {
  bench.profile = 2;
  await bench.frames(2);
  bench.axes = { ...STILL, forward: 1 };
  await bench.frames(1, { answer: false });
  bench.axes = STILL;
  await bench.frames(3);
  expect(bench.replies.map(({ pose, asked }) => [pose, asked])).toEqual([
    [bench.rig.pose.seq - 1, 2],
    [bench.rig.pose.seq, 2],
  ]);
  const { arrival } = bench.replies[1] as Reply;
  expect(arrival.lastByteAt - arrival.sentAt).toBeCloseTo(1000 / 60, 3);
});

test("an input made while the server is away does not count as latency afterwards", async () => {
  await bench.frames(2);
  bench.player.attach(null);
  bench.axes = { ...STILL, turnRight: 1 };
  await bench.frames(300);
  bench.axes = STILL;
  bench.connect();
  await bench.frames(20);
  expect(bench.transport.requests).toHaveLength(1);
  expect(bench.player.stats.value.motionToPhoton?.p95 ?? 0).toBeLessThan(100);
});

test("a lens that a person set stays when the stage changes; the rest follows", async () => {
  bench.rig.lens.value = { fx: 900 };
  bench.rig.resize(600, 600);
  await bench.frames(1);
  expect(bench.last()).toMatchObject({ fx: 900, cx: 300, cy: 300, width: 600, height: 600 });
  expect(bench.last()?.fy).toBeCloseTo(519.62, 2);
});

test("while it turns asks for where the camera will be, as soon as it is known how long frames take, and at rest for where it is", async () => {
  bench.prediction = "velocity";
  await bench.frames(3);
  bench.axes = { ...STILL, turnRight: 1 };
  await bench.frames(20);
  const asked = bench.transport.requests.at(-1)?.request.quaternion ?? [0, 0, 0, 1];
  // Frames are on the screen two animation frames after their request, and stay for one: 42 ms at 60 degrees per second.
  expect(angleBetween(bench.rig.pose.quaternion, asked)).toBeCloseTo(2.5, 3);
  bench.axes = STILL;
  await bench.frames(40);
  expect(bench.last()?.quaternion).toEqual(bench.rig.pose.quaternion);
  expect(bench.player.stats.value.settled).toBe(true);
});

test.each([
  { link: "a slow link", transmission: 200, webp: true, format: "webp" },
  { link: "a slow link where the person wants none", transmission: 200, webp: false, format: undefined },
  { link: "a fast link", transmission: 4, webp: true, format: undefined },
])("over $link, pictures come as $format", async ({ transmission, webp, format }) => {
  bench.webp = webp;
  bench.axes = { ...STILL, forward: 1 };
  for (let i = 0; i < 40; i++) {
    await bench.frames(1, { answer: false });
    bench.now += transmission;
    for (const request of bench.transport.requests) request.reply({ bytes: 25_000, transmission });
  }
  expect(bench.transport.requests[0]?.request.format).toBeUndefined();
  expect(bench.last()?.format).toBe(format);
});

test("after a hidden page, the first frame shown is of a view wanted since then", async () => {
  await bench.frames(10);
  bench.axes = { ...STILL, turnRight: 1 };
  await bench.frames(5);
  bench.axes = STILL;
  const [shown, asked] = [bench.shown.length, bench.transport.requests.length];
  bench.player.resumed(30_000);
  bench.now += 30_000;
  await bench.frames(5);
  expect(bench.shown[shown]?.asked.seq).toBeGreaterThanOrEqual(asked);
  expect(bench.player.stats.value.motionToPhoton?.p95 ?? 0).toBeLessThan(100);
});
