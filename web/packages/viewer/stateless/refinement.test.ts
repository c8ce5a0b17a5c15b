import { beforeEach, describe, expect, test } from "vitest";
import { fakeView } from "#fakes/views";
import type { ViewRequest } from "./pipeline";
import { type PosedRequest, Refinement, Rest } from "./refinement";

const FRAME = 1000 / 60;
const FAST = 1e9;
const RESTING = { settled: true, throughput: FAST, pixelRatio: 1 };
let subject: Refinement;
let now: number;

beforeEach(() => {
  subject = new Refinement();
  now = 0;
});

function view(changes: Partial<PosedRequest> = {}): PosedRequest {
  const lens = fakeView({ fx: 600, fy: 600, cx: 350, cy: 200, width: 700, height: 400 });
  return { ...lens, scene: "s", position: [0, 0, 0], quaternion: [0, 0, 0, 1], profile: 3, ...changes };
}

interface Server {
  /** Bits per second; null: not known. */
  readonly throughput?: number | null;
  readonly pixelRatio?: number;
  /** Milliseconds a megapixel. */
  readonly render?: number;
  readonly bytesAPixel?: number;
}

/** Records a frame of this size. */
function came(
  size: { width: number; height: number },
  profile: number | null,
  { render = 10, bytesAPixel = 0.2 }: Server,
) {
  const pixels = size.width * size.height;
  const timing = { queue: 0, render: (render * pixels) / 1e6, encode: 0 };
  const arrival = { sentAt: 0, firstByteAt: 0, lastByteAt: 0, bytes: pixels * bytesAPixel, sharedBytes: 0 };
  const header = { status: 200, seq: 0, content_type: "image/jpeg", ...size, profile, timing };
  subject.observe({ header, arrival });
}

/** All steps requested at rest, each answered before the next animation frame. */
function steps(server: Server = {}, wanted = view()): ViewRequest[] {
  const { throughput = FAST, pixelRatio = 2 } = server;
  came({ width: 320, height: 180 }, wanted.profile ?? null, server);
  const asked: ViewRequest[] = [];
  for (const until = now + 1000; now < until; now += FRAME) {
    const step = subject.next(wanted, { now, settled: true, throughput, pixelRatio });
    if (step === null || step === asked.at(-1)) continue;
    asked.push(step);
    came(step, null, server);
  }
  return asked;
}

const sizes = (asked: readonly ViewRequest[]) => asked.map(({ width, height }) => [width, height]);

test("on a fast link the screen's own pixels are asked for at once, with the same field of view", () => {
  const [step, ...more] = steps();
  expect(step).toEqual({
    ...view(),
    profile: undefined,
    fx: 1200,
    fy: 1200,
    cx: 700,
    cy: 400,
    width: 1400,
    height: 800,
  });
  expect(more).toEqual([]);
  expect(subject.pending).toBe(false);
});

test("neither margins nor depth are asked for", () => {
  const [step] = steps({}, view({ overscan: 0.2, depth: true }));
  expect(step).not.toHaveProperty("overscan");
  expect(step).not.toHaveProperty("depth");
});

test("a view that changes is not refined, nor one that is not on the screen yet", () => {
  came({ width: 320, height: 180 }, 3, {});
  for (let i = 0; i < 60; i++, now += FRAME) {
    const turned = view({ position: [i, 0, 0] });
    expect(subject.next(turned, { now, ...RESTING })).toBeNull();
  }
  for (let i = 0; i < 60; i++, now += FRAME) {
    expect(subject.next(view(), { now, ...RESTING, settled: false })).toBeNull();
  }
});

test("margins that come and go are no movement", () => {
  came({ width: 320, height: 180 }, 3, {});
  let step: ViewRequest | null = null;
  for (let i = 0; i < 12; i++, now += FRAME) {
    step = subject.next(view({ overscan: i / 100 }), { now, ...RESTING });
  }
  expect(step).not.toBeNull();
});

test("a slower link gets steps: one of a moment, then four times its pixels", () => {
  const asked = steps({ throughput: 3.5e6, bytesAPixel: 240_000 / (1280 * 720) });
  const [first = 0, second = 0, ...rest] = asked.map(({ width, height }) => width * height);
  expect((first * 0.26 * 8) / 3.5e6).toBeCloseTo(0.15, 2);
  expect(second / first).toBeCloseTo(4, 1);
  expect(rest).toEqual([1400 * 800]);
  expect(asked[0]?.display_scale).toBeCloseTo(1400 / (asked[0]?.width ?? 0), 9);
  expect(asked[2]).not.toHaveProperty("display_scale");
});

test("a link that takes too long for the screen's pixels stops at what it takes in three seconds", () => {
  const asked = steps({ throughput: 0.4e6 });
  const { width = 0, height = 0 } = asked.at(-1) ?? {};
  expect((width * height * 0.2 * 8) / 0.4e6).toBeGreaterThan(2.7);
  expect((width * height * 0.2 * 8) / 0.4e6).toBeLessThan(3.01);
  expect(subject.pending).toBe(false);
});

test("a server that takes long is not kept from new movement", () => {
  const asked = steps({ render: 600 });
  const { width = 0, height = 0 } = asked.at(-1) ?? {};
  expect(width * height * 600e-6).toBeLessThanOrEqual(300);
  expect(width).toBeGreaterThan(900);
});

test("a best rung that has the screen's pixels is as sharp as it gets", () => {
  const wanted = view({ profile: 0 });
  came({ width: 1400, height: 800 }, 0, {});
  for (let i = 0; i < 60; i++, now += FRAME) {
    expect(subject.next(wanted, { now, ...RESTING, pixelRatio: 2 })).toBeNull();
  }
  expect(subject.pending).toBe(false);
});

test("a lesser one with as many pixels is not", () => {
  came({ width: 700, height: 400 }, 2, {});
  for (let i = 0; i < 12; i++, now += FRAME) subject.next(view(), { now, ...RESTING });
  expect(subject.next(view(), { now, ...RESTING, settled: false })).toMatchObject({ width: 700 });
});

describe("again", () => {
  test("after a movement", () => {
    steps();
    expect(sizes(steps({}, view({ position: [1, 0, 0] })))).toEqual([[1400, 800]]);
  });

  test("when the window moves to a screen with more pixels", () => {
    expect(sizes(steps({ pixelRatio: 1 }))).toEqual([[700, 400]]);
    expect(sizes(steps({ pixelRatio: 2 }))).toEqual([[1400, 800]]);
  });
});

test("a step that failed is not tried again, and what was seen before it stays", () => {
  came({ width: 320, height: 180 }, 3, {});
  const rest = (settled: boolean) => {
    now += 200;
    return subject.next(view(), { now, settled, throughput: 4e6, pixelRatio: 2 });
  };
  rest(true);
  const first = rest(true);
  came({ width: 634, height: 362 }, null, {});
  const second = rest(true);
  expect(second).not.toEqual(first);
  subject.failed();
  expect([rest(false), rest(true)]).toEqual([first, first]);
  expect(subject.pending).toBe(false);
});

test("a stage beyond the server's limits is refined within them", () => {
  const wide = view({ width: 8000, height: 1500, cx: 4000, cy: 750 });
  const { width = 0, height = 0 } = steps({ render: 0 }, wide).at(-1) ?? {};
  expect(width).toBeLessThanOrEqual(8192);
  expect(width * height).toBeLessThanOrEqual(16_777_216);
});

test.each([
  [null, []],
  [{ key: false, after: 0, codec: "avc1.42c01f" }, [[700, 400]]],
])("the best rung has all that the screen shows, unless it came as a frame of a video: %o", (video, expected) => {
  const wanted = view({ profile: 0 });
  const arrival = { sentAt: 0, firstByteAt: 0, lastByteAt: 0, bytes: 9000, sharedBytes: 0 };
  const header = { status: 200, seq: 0, content_type: "", width: 700, height: 400, profile: 0, video };
  subject.observe({ header, arrival });
  subject.next(wanted, { now: 0, ...RESTING });
  const step = subject.next(wanted, { now: 1000, ...RESTING });
  expect(step === null ? [] : sizes([step])).toEqual(expected);
});

describe("rest", () => {
  const VIEW: ViewRequest = view({ overscan: 0.1 });
  const [CONTROLLER, ANOTHER] = [{}, {}];

  /** The request that follows an earlier one. */
  function then(changes: Partial<ViewRequest>, chooser: unknown = CONTROLLER): ViewRequest {
    const rest = new Rest();
    rest.view(VIEW, CONTROLLER);
    return rest.view({ ...VIEW, ...changes }, chooser);
  }

  test.each([{ profile: 5 }, { overscan: 0.05 }, { profile: 4, overscan: 0 }])(
    "at rest the same view is not requested with less: %o",
    (changes) => expect(then(changes)).toBe(VIEW),
  );

  test.each([
    { profile: 2 },
    { overscan: 0.2 },
    { profile: 2, overscan: 0 },
    { azimuth: 1, profile: 5 },
    { depth: true },
  ])("at rest more of it is requested, and in motion another view: %o", (changes) =>
    expect(then(changes)).toEqual({ ...VIEW, ...changes }),
  );

  test("a worse rung that a person has chosen is shown at once", () => {
    expect(then({ profile: 5 }, ANOTHER).profile).toBe(5);
  });

  test("of a video, a better bit rate is worth another frame of the same view, and a worse one is not", () => {
    const rest = new Rest();
    const at = (bitrate_kbps: number) => ({ ...VIEW, format: "h264" as const, video: { bitrate_kbps } });
    const first = rest.view(at(2000), CONTROLLER);
    expect(rest.view(at(1000), CONTROLLER)).toBe(first);
    expect(rest.view(at(3000), CONTROLLER)).toEqual(at(3000));
  });
});
