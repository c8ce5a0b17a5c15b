import { beforeEach, describe, expect, test, vi } from "vitest";
import type { Observation } from "../abr/controller";
import { Display } from "../enhance/display";
import { Enhancement } from "../enhance/enhancement";
import { PLACE } from "../enhance/fake-gpu";
import { Overlay } from "../enhance/overlay";
import type { PredictorName } from "../predict/registry";
import { FakeWarp } from "../reproject/fake-warp";
import { Reprojector } from "../reproject/reprojector";
import { FakeTransport, settle } from "../transport/fake";
import { NO_NUDGE } from "../view/motion";
import type { PresentedFrame } from "../view/presented";
import { Rig } from "../view/rig";
import { angleBetween } from "../view/vector";
import type { DecodedFrame } from "./pipeline";
import { type Reply, type ShownFrame, StatelessPlayer } from "./stateless-player";
import type { Pictured } from "./turning";

const SCENE = PLACE.scene;
const STILL = { forward: 0, right: 0, up: 0, turnRight: 0, turnUp: 0 };

let now: number;
let axes: typeof STILL;
let profile: number;
let refine: boolean;
let observed: (observation: Observation) => void;
let prediction: PredictorName;
let overscan: number | "auto";
let depth: boolean;
let surround: boolean;
let drawn: unknown[];
let reprojector: Reprojector<Pictured>;
let warp: FakeWarp;
let replies: Reply[];
let shown: ShownFrame[];
let presented: PresentedFrame[];
let transport: FakeTransport;
let rig: Rig;
let player: StatelessPlayer;

beforeEach(() => {
  now = 1000;
  axes = STILL;
  profile = 0;
  refine = false;
  observed = () => undefined;
  prediction = "off";
  overscan = "auto";
  depth = true;
  surround = false;
  drawn = [];
  replies = [];
  shown = [];
  transport = new FakeTransport(() => now);
  const canvas = {
    style: {},
    getContext: () => ({ transferFromImageBitmap: (bitmap: unknown) => drawn.push(bitmap) }),
  };
  const overlay = new Overlay(canvas as unknown as HTMLCanvasElement);
  rig = new Rig({ sampleInput: () => ({ axes, nudge: NO_NUDGE }), turnSpeed: () => 60 });
  play(
    new Display<DecodedFrame>({
      canvas: canvas as unknown as HTMLCanvasElement,
      overlay,
      enhancement: new Enhancement({ overlay, now: () => now }),
      size: () => ({ width: 1280, height: 720 }),
    }),
  );
});

function play(display: Display<DecodedFrame>): void {
  presented = [];
  reprojector = new Reprojector({
    below: { after: () => undefined, ownerDocument: { createElement: fakeCanvas } } as unknown as HTMLElement,
    size: () => ({ width: 1280, height: 720 }),
    now: () => now,
    create: (canvas, options) => {
      warp = new FakeWarp(canvas, options);
      return warp;
    },
  });
  player = new StatelessPlayer({
    display,
    reprojector,
    overscan: () => overscan,
    depth: () => depth,
    surround: () => surround,
    ladder: () => PLACE.ladder,
    rig,
    decoder: {
      decode: async () => ({
        bitmap: { width: 1280, height: 720, close: () => undefined } as ImageBitmap,
        depth: null,
      }),
    },
    controller: () => ({ decide: () => profile, observe: observed }),
    refine: () => refine,
    pixelRatio: () => 2,
    prediction: () => prediction,
    stamp: false,
    onPresented: (frame) => presented.push(frame),
    onShown: (frame) => shown.push(frame),
    onSent: () => undefined,
    onReplied: (reply) => replies.push(reply),
    onReceived: () => undefined,
    now: () => now,
  });
  rig.resize(1280, 720);
  rig.enter(SCENE);
  player.attach({ transport, fallback: null });
}

/** Animation frames at 60 Hz; the server answers whatever was asked when `answer` says so. */
async function frames(count: number, { answer = true } = {}): Promise<void> {
  for (let i = 0; i < count; i++) {
    now += 1000 / 60;
    player.presented(now);
    player.tick(now, rig.sample(now));
    if (answer) for (const { reply } of transport.requests) reply();
    await settle();
  }
}

const last = () => transport.requests.at(-1)?.request;

test("tells of each frame on the screen what was asked for and what came, one animation frame later", async () => {
  await frames(2);
  expect([shown, drawn]).toEqual([[], [expect.anything()]]);
  await frames(1);
  const [asked] = transport.requests.map(({ request }) => request);
  expect(shown).toEqual([
    { at: now, asked, header: expect.objectContaining({ seq: 0 }), image: expect.any(Blob), enhanced: null },
  ]);
  expect(asked).toMatchObject({ seq: 0, scene: "courtyard", width: 1280 });
  await frames(2);
  expect(shown).toHaveLength(1);
});

test("enters at the scene's start camera, with the stage's own lens", async () => {
  await frames(1);
  expect(last()).toMatchObject({ scene: "courtyard", position: [0, -2, -8], quaternion: [0, 0, 0, 1] });
  expect(last()).toMatchObject({ width: 1280, height: 720, cx: 640, cy: 360, profile: 0 });
  expect(rig.moveSpeed.value).toBe(2);
});

test("a still camera asks for one frame and no more", async () => {
  await frames(200);
  expect(transport.requests).toHaveLength(1);
  expect(drawn).toHaveLength(1);
  expect(player.stats.value).toMatchObject({ settled: true, shown: 1 });
});

test("walking asks for the views along the way, and for the last one for sure", async () => {
  await frames(3);
  axes = { ...STILL, forward: 1 };
  await frames(30);
  axes = STILL;
  await frames(30);
  expect(last()?.position?.[2]).toBeCloseTo(-8 + 2 * 0.5, 1);
  expect(player.stats.value.settled).toBe(true);
});

test("motion-to-photon counts from the sample to the animation frame after the drawing", async () => {
  await frames(2);
  axes = { ...STILL, turnRight: 1 };
  await frames(1, { answer: false }); // sampled and sent
  axes = STILL;
  await frames(2); // 17 ms later it is answered, then drawn
  await frames(20); // and on the screen in the animation frame after that
  expect(player.stats.value.motionToPhoton?.p50).toBeCloseTo(3 * (1000 / 60), 3);
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
  transport = new FakeTransport(() => now);
  play(display as unknown as Display<DecodedFrame>);
  await frames(6);
  axes = { ...STILL, turnRight: 1 };
  await frames(1, { answer: false });
  axes = STILL;
  await frames(2);
  expect(player.stats.value.settled).toBe(false);
  await frames(20);
  expect(player.stats.value.motionToPhoton?.p50).toBeCloseTo(5 * (1000 / 60), 3);
  expect(player.stats.value).toMatchObject({ settled: true, enhanceMs: 40, shown: 2 });
  expect(presented.at(-1)).toMatchObject({ shownWidth: 1280, shownHeight: 720, enhanceMs: 40 });
  expect(shown.at(-1)).toMatchObject({ enhanced: { upscale: "scene" } });
});

describe("refining", () => {
  const asked = () => transport.requests.map(({ request: { profile, width } }) => [profile, width]);

  test("asks for the screen's own pixels once the camera stands still, and for the rung when it moves again", async () => {
    profile = 3;
    refine = true;
    await frames(40);
    expect(asked()).toEqual([
      [3, 1280],
      [undefined, 2560],
    ]);
    expect(last()).toMatchObject({ height: 1440, cx: 1280, cy: 720 });
    axes = { ...STILL, forward: 1 };
    await frames(2);
    expect(last()).toMatchObject({ profile: 3, width: 1280 });
  });

  test("is not heard of by the controller", async () => {
    const heard: unknown[] = [];
    observed = (observation) => heard.push(observation.profile);
    profile = 3;
    refine = true;
    await frames(40);
    expect(replies.map(({ asked }) => asked)).toEqual([3, null]);
    expect(heard).toEqual([3]);
  });

  test("the view is settled when it is as sharp as it gets", async () => {
    refine = true;
    await frames(8);
    expect(shown).toHaveLength(1);
    expect(player.stats.value.settled).toBe(false);
    await frames(40);
    expect(player.stats.value.settled).toBe(true);
  });

  test("a step that fails leaves what is shown, and is not tried again before the camera moves", async () => {
    refine = true;
    profile = 3;
    await frames(3);
    while (transport.requests.length < 2) await frames(1, { answer: false });
    transport.requests[1]?.fail(new Error("too large"));
    await frames(100);
    expect(asked().map(([rung]) => rung)).toEqual([3, undefined, 3]);
    expect(player.stats.value.settled).toBe(true);
    expect(player.problem.value).toBeNull();
  });

  test("can be left out", async () => {
    profile = 3;
    await frames(60);
    expect(transport.requests.map(({ request }) => request.profile)).toEqual([3]);
  });
});

test("tells of each reply: when it came, of which pose, and the rung that was asked for", async () => {
  profile = 2;
  await frames(2);
  axes = { ...STILL, forward: 1 };
  await frames(1, { answer: false });
  axes = STILL;
  await frames(3);
  expect(replies.map(({ pose, asked }) => [pose, asked])).toEqual([
    [rig.pose.seq - 1, 2],
    [rig.pose.seq, 2],
  ]);
  const { arrival } = replies[1] as Reply;
  expect(arrival.lastByteAt - arrival.sentAt).toBeCloseTo(1000 / 60, 3);
});

test("an input made while the server is away does not count as latency afterwards", async () => {
  await frames(2);
  player.attach(null);
  axes = { ...STILL, turnRight: 1 };
  await frames(300);
  axes = STILL;
  transport = new FakeTransport(() => now);
  player.attach({ transport, fallback: null });
  await frames(20);
  expect(transport.requests).toHaveLength(1);
  expect(player.stats.value.motionToPhoton?.p95 ?? 0).toBeLessThan(100);
});

test("a lens that a person set stays when the stage changes; the rest follows", async () => {
  rig.lens.value = { fx: 900 };
  rig.resize(600, 600);
  await frames(1);
  expect(last()).toMatchObject({ fx: 900, cx: 300, cy: 300, width: 600, height: 600 });
  expect(last()?.fy).toBeCloseTo(519.62, 2);
});

test("while it turns asks for where the camera will be, as soon as it is known how long frames take, and at rest for where it is", async () => {
  prediction = "velocity";
  await frames(3);
  axes = { ...STILL, turnRight: 1 };
  await frames(20);
  const asked = transport.requests.at(-1)?.request.quaternion ?? [0, 0, 0, 1];
  // Frames are on the screen two animation frames after they were asked for, and stay there for one: 42 ms at 60 degrees a second.
  expect(angleBetween(rig.pose.quaternion, asked)).toBeCloseTo(2.5, 3);
  axes = STILL;
  await frames(40);
  expect(last()?.quaternion).toEqual(rig.pose.quaternion);
  expect(player.stats.value.settled).toBe(true);
});

const fakeCanvas = () => ({ classList: { add: () => undefined }, remove: () => undefined, width: 0, height: 0 });

describe("with reprojection", () => {
  beforeEach(() => reprojector.on(10));

  test("a turn is seen in the next animation frame, and the pixels are as old as they are", async () => {
    await frames(10);
    presented = [];
    axes = { ...STILL, turnRight: 1 };
    await frames(12, { answer: false });
    expect(presented).toHaveLength(11);
    for (const one of presented) {
      expect(one.latencies).toEqual([expect.closeTo(1000 / 60, 3)]);
      expect(one.view).toBeGreaterThan(one.pose);
    }
    expect(new Set(presented.map(({ pose }) => pose)).size).toBe(1);
    await frames(30, { answer: false });
    expect(player.stats.value.motionToPhoton?.p50).toBeCloseTo(1000 / 60, 1);
    expect(player.stats.value.contentAge).toBeGreaterThan(200);
    expect(player.stats.value).toMatchObject({ turned: true, shown: 1, framesPerSecond: 0 });
  });

  test("asks for where the camera will be, and draws where it will be when that is seen: one animation frame later", async () => {
    prediction = "velocity";
    await frames(3);
    axes = { ...STILL, turnRight: 1 };
    await frames(20);
    expect(angleBetween(rig.pose.quaternion, last()?.quaternion ?? [0, 0, 0, 1])).toBeCloseTo(2.5, 2);
    expect(angleBetween(rig.pose.quaternion, warp.drawn.at(-1)?.quaternion ?? [0, 0, 0, 1])).toBeCloseTo(1, 2);
    axes = STILL;
    await frames(20);
    expect(warp.drawn.at(-1)?.quaternion).toEqual(rig.pose.quaternion);
  });

  test("only new frames count as frames, and as an end of a stall", async () => {
    await frames(10);
    axes = { ...STILL, turnRight: 1 };
    await frames(20);
    await frames(30, { answer: false });
    await frames(20);
    expect(player.stats.value.stalls.count).toBe(1);
    expect(presented.length).toBeGreaterThan(50);
  });

  test("at rest the frame itself is shown, and nothing is drawn", async () => {
    axes = { ...STILL, turnRight: 1 };
    await frames(20);
    axes = STILL;
    await frames(40);
    const draws = warp.drawn.length;
    await frames(100);
    expect(warp.drawn).toHaveLength(draws);
    expect(last()).not.toHaveProperty("overscan");
    expect(presented.at(-1)).toMatchObject({ view: rig.pose.seq, pose: rig.pose.seq, filled: 0 });
  });

  test("asks for margins and for depth as it is set", async () => {
    overscan = 0.2;
    await frames(5);
    expect(last()).toMatchObject({ overscan: 0.2, depth: true });
    depth = false;
    await frames(5);
    expect(last()).not.toHaveProperty("depth");
    reprojector.off();
    depth = true;
    await frames(5);
    expect(last()).not.toHaveProperty("overscan");
    expect(last()).not.toHaveProperty("depth");
  });

  test("margins of enhanced frames come in few sizes", async () => {
    vi.spyOn(Display.prototype, "enhances", "get").mockReturnValue(true);
    axes = { ...STILL, turnRight: 1 };
    await frames(10);
    await frames(20, { answer: false });
    await frames(20);
    vi.restoreAllMocks();
    const margins = new Set(transport.requests.map(({ request }) => request.overscan ?? 0));
    expect([...margins].filter((margin) => ![0, 0.125, 0.25].includes(margin))).toEqual([]);
    expect(margins.size).toBeGreaterThan(1);
  });

  test("margins of the frame that came are what counts, not those that are asked for by now", async () => {
    overscan = 0.25;
    await frames(1);
    overscan = 0;
    await frames(4);
    const [first] = warp.taken;
    const { fx } = rig.intrinsics.value;
    expect(first?.view).toMatchObject({ width: 1280, cx: 640, fx: expect.closeTo(fx / 1.5) });
    expect(warp.taken.at(-1)?.view).toMatchObject({ width: 1280, cx: 640, fx: expect.closeTo(fx) });
  });

  test("samples tell of frames as they came", async () => {
    axes = { ...STILL, turnRight: 1 };
    await frames(20);
    expect(shown.length).toBeGreaterThan(5);
    expect(shown.length).toBeLessThan(presented.length + 1);
    expect(shown[0]?.image).toBeInstanceOf(Blob);
  });
});

describe("with a surround", () => {
  let received: number;

  beforeEach(() => {
    surround = true;
    received = 0;
  });

  const sides = () => transport.requests.filter(({ request }) => request.width === request.height);

  test("small pictures of all directions come once the first view is on the screen, and nothing hears of them but the throughput", async () => {
    reprojector.on(8);
    observed = () => received++;
    await frames(1, { answer: false });
    await frames(2, { answer: false });
    expect(sides()).toHaveLength(0);
    await frames(120);
    expect(sides()).toHaveLength(6);
    expect(new Set(sides().map(({ request }) => request.profile))).toEqual(new Set([3]));
    expect([warp.sides.length, received, replies.length]).toEqual([6, 1, 1]);
    expect(player.stats.value).toMatchObject({ settled: true, frame: { width: 1280 }, counts: { sent: 1 } });
    expect(new Set(transport.requests.map(({ request }) => request.seq)).size).toBe(7);
  });

  test.each(["off", "without reprojection"])("asks for nothing besides: %s", async (how) => {
    if (how === "off") {
      surround = false;
      reprojector.on(8);
    }
    await frames(120);
    expect(transport.requests).toHaveLength(1);
  });

  test("another connection begins where the last one ended", async () => {
    reprojector.on(8);
    await frames(10, { answer: false });
    for (const { reply } of transport.requests) reply();
    await frames(3, { answer: false });
    expect(sides()).toHaveLength(1);
    transport = new FakeTransport(() => now);
    player.attach({ transport, fallback: null });
    await frames(120);
    expect([sides().length, warp.sides.length]).toEqual([6, 6]);
  });
});
