import { beforeEach, describe, expect, test } from "vitest";
import { deferred } from "#client/async/deferred";
import { type DecodedImage, FrameDropped, RequestProblem } from "#client/transport/transport";
import { FakeTransport, settle } from "#fakes/transport";
import { view } from "#fakes/views";
import { FramePipeline, type SentRequest, type ViewRequest } from "./pipeline";

let now: number;
let transport: FakeTransport;
let bitmaps: { closed: boolean; close(): void }[];
let refusals: string[];
let requests: SentRequest[];
let unrefined: number;

function pipeline(decode?: () => Promise<DecodedImage>): FramePipeline {
  const decodeNow = async () => {
    const bitmap = {
      closed: false,
      close() {
        this.closed = true;
      },
    };
    bitmaps.push(bitmap);
    return { bitmap: bitmap as unknown as ImageBitmap, depth: null };
  };
  return new FramePipeline(transport, decode ?? decodeNow, () => now, {
    sent: (request) => requests.push(request),
    replied: () => undefined,
    refused: (problem) => refusals.push(problem.message),
    unrefined: () => {
      unrefined++;
    },
    format: () => "jpeg",
    transmission: () => 0,
  });
}

/** A pipeline after its first request. */
function asking(x = 1, decode?: () => Promise<DecodedImage>): FramePipeline {
  const subject = pipeline(decode);
  subject.want(view(x), 0);
  return subject;
}

const problem = (type: string) => new RequestProblem({ type, title: "", status: 400, detail: `because of ${type}` });
const sent = () => transport.requests.map(({ request }) => request.position?.[0]);

/** One animation frame later, with everything settled that can be. */
async function frame(subject: FramePipeline, wanted: ViewRequest): Promise<number | undefined> {
  await settle();
  now += 16;
  subject.want(wanted, 0);
  const taken = subject.take();
  await settle();
  return taken?.seq;
}

beforeEach(() => {
  now = 0;
  transport = new FakeTransport(() => now);
  bitmaps = [];
  refusals = [];
  requests = [];
  unrefined = 0;
});

test("after a pause no old frame is shown, and the same view is asked for anew", async () => {
  const subject = asking();
  transport.requests[0]?.reply();
  await settle();
  expect(await frame(subject, view(2))).toBe(0);
  transport.requests[1]?.reply();
  await settle(); // decoded, but not taken
  subject.want(view(3), 0);
  subject.pause();
  expect(subject.take()).toBeUndefined();
  expect(bitmaps.map(({ closed }) => closed)).toEqual([false, true]);
  expect(transport.requests[2]?.signal.aborted).toBe(true);
  await frame(subject, view(3));
  expect(sent()).toEqual([1, 2, 3, 3]);
  transport.requests[3]?.reply();
  expect(await frame(subject, view(3))).toBe(3);
});

test("a bitmap that is decoded after its viewer was closed is closed, too", async () => {
  const decoding = deferred<DecodedImage>();
  let closed = false;
  const subject = asking(1, () => decoding.promise);
  transport.requests[0]?.reply();
  await settle();
  subject.dispose();
  const close = () => {
    closed = true;
  };
  decoding.resolve({ bitmap: { close } as unknown as ImageBitmap, depth: null });
  await settle();
  expect(closed).toBe(true);
  expect(subject.take()).toBeUndefined();
});

describe("asking for frames", () => {
  test("a view is asked for once, and nothing is asked while it stays the same", async () => {
    const subject = asking();
    transport.requests[0]?.reply();
    expect(await frame(subject, view(1))).toBe(0);
    for (let i = 0; i < 5; i++) await frame(subject, view(1));
    expect(transport.requests).toHaveLength(1);
    expect(subject.settled).toBe(true);
  });

  test("while the limit is reached the newest view waits, and the ones between are never asked for", async () => {
    transport = new FakeTransport(() => now, { maxInFlight: 1 });
    const subject = pipeline();
    for (const x of [1, 2, 3, 4]) await frame(subject, view(x));
    expect(sent()).toEqual([1]);
    transport.requests[0]?.reply();
    await frame(subject, view(4));
    expect(sent()).toEqual([1, 4]);
  });

  test.each<Partial<ViewRequest>>([
    { position: [0, 0, 1e-6] },
    { quaternion: [0, 0, 1, 0] },
    { fx: 2 },
    { width: 3 },
    { scene: "other" },
    { profile: 3 },
  ])("a change to %o alone asks for the view again", async (change) => {
    const subject = asking(0);
    transport.requests[0]?.reply();
    await frame(subject, view(0));
    for (const wanted of [{ ...view(0), ...change }, view(0)]) {
      await frame(subject, wanted);
      transport.requests.at(-1)?.reply();
    }
    expect(transport.requests.map(({ request: { seq: _, ...wanted } }) => wanted)).toEqual([
      view(0),
      { ...view(0), ...change },
      view(0),
    ]);
  });
});

test.each([
  [60, 6],
  [120, 12],
])("at %i frames/s and 95 ms there and back, %i requests are in flight", async (rate, expected) => {
  const subject = pipeline();
  for (let x = 0; x < 2 * rate; x++) {
    now += 1000 / rate;
    for (const request of transport.requests) if (now - request.sentAt >= 95) request.reply();
    await settle();
    subject.want(view(x), 0);
    subject.take();
  }
  expect(subject.inFlight).toBe(expected);
});

test("a busy server is asked as often as it says", async () => {
  const subject = pipeline();
  for (let x = 0; x < 120; x++) {
    for (const request of transport.requests) request.reply({ requestsPerS: 10 });
    await frame(subject, view(x));
  }
  expect(transport.requests.length).toBeGreaterThan(15);
  expect(transport.requests.length).toBeLessThan(24); // 120 animation frames of 16 ms
});

test("that the page asked too often is not said to the person, and it pauses", async () => {
  const subject = asking();
  transport.requests[0]?.fail(problem("tigas:asked-too-often"));
  for (let x = 2; x < 8; x++) await frame(subject, view(x));
  expect(refusals).toEqual([]);
  expect(transport.requests).toHaveLength(1);
  for (let x = 8; x < 14; x++) await frame(subject, view(x));
  expect(transport.requests.length).toBeGreaterThan(1);
});

test("the outcome of each request is reported", async () => {
  const subject = pipeline();
  subject.want(view(0), 7);
  transport.requests[0]?.reply({ timing: { queue: 0, render: 60, encode: 0 } });
  for (const x of [1, 2, 3]) await frame(subject, view(x));
  transport.requests[2]?.fail(new FrameDropped("lost"));
  await frame(subject, view(4));
  transport.requests[3]?.reply(); // decoded in the same animation frame as the next, which takes its place
  transport.requests[4]?.reply();
  await frame(subject, view(5));
  expect(requests.map(({ fate }) => fate)).toEqual([
    "shown",
    "cancelled",
    "dropped",
    "overtaken",
    "shown",
    "unanswered",
  ]);
  expect(requests[0]).toMatchObject({ at: 0, pose: 7, asked: 0 });
});

describe("showing frames", () => {
  test("a shown frame cancels the older requests and no newer one", async () => {
    const subject = asking(0);
    transport.requests[0]?.reply({ timing: { queue: 0, render: 60, encode: 0 } });
    for (const x of [1, 2, 3]) await frame(subject, view(x));
    expect(sent()).toEqual([0, 1, 2, 3]);
    transport.requests[2]?.reply();
    expect(await frame(subject, view(3))).toBe(2);
    expect(transport.requests.map(({ signal }) => signal.aborted)).toEqual([false, true, false, false]);
    expect(subject.counts).toMatchObject({ sent: 4, cancelled: 1, dropped: 0 });
  });

  test("of two frames that come between two animation frames the newer is shown and the other closed", async () => {
    const subject = asking(0);
    transport.requests[0]?.reply({ timing: { queue: 0, render: 60, encode: 0 } });
    await frame(subject, view(1));
    await frame(subject, view(2));
    transport.requests[2]?.reply();
    transport.requests[1]?.reply();
    expect(await frame(subject, view(2))).toBe(2);
    expect(await frame(subject, view(2))).toBeUndefined();
    expect(bitmaps.map(({ closed }) => closed)).toEqual([false, false, true]);
  });

  test("a picture decoded after the viewer has closed is closed", async () => {
    const subject = asking();
    transport.requests[0]?.reply();
    await settle();
    subject.dispose();
    expect(bitmaps.map(({ closed }) => closed)).toEqual([true]);
    expect(subject.inFlight).toBe(0);
  });
});

describe("failures", () => {
  test.each([
    ["superseded", () => problem("tigas:superseded")],
    ["too late", () => problem("tigas:deadline-exceeded")],
    ["lost on the way", () => new FrameDropped("lost")],
  ])(
    "a frame that is %s is counted, not shown as an error, and asked for again if it is the newest",
    async (_, error) => {
      const subject = asking();
      transport.requests[0]?.fail(error());
      await frame(subject, view(1));
      expect(sent()).toEqual([1, 1]);
      expect(refusals).toEqual([]);
      expect(subject.counts.dropped).toBe(1);
    },
  );

  test("the last view is rendered even if its request fails when nothing moves any more", async () => {
    const subject = asking();
    transport.requests[0]?.fail(new Error("stream was reset"));
    for (let i = 0; i < 20 && transport.requests.length < 2; i++) await frame(subject, view(1));
    transport.requests[1]?.reply();
    await frame(subject, view(1));
    expect(subject.settled).toBe(true);
  });

  test("a refusal is reported, and the server is not asked again with every animation frame", async () => {
    const subject = asking();
    transport.requests[0]?.fail(problem("tigas:broken-scene"));
    for (let i = 0; i < 5; i++) await frame(subject, view(1));
    expect(refusals).toEqual(["because of tigas:broken-scene"]);
    expect(transport.requests).toHaveLength(1);
  });

  test("an image that cannot be decoded is a dropped frame", async () => {
    const subject = asking(1, () => Promise.reject(new Error("no image")));
    transport.requests[0]?.reply();
    await frame(subject, view(1));
    expect(subject.counts.dropped).toBe(1);
    expect(subject.settled).toBe(false);
  });
});

describe("a refinement, which is a request without a rung", () => {
  const refined = { ...view(1), profile: null };

  async function refining(): Promise<FramePipeline> {
    const subject = asking();
    transport.requests[0]?.reply();
    await frame(subject, view(1));
    await frame(subject, refined);
    return subject;
  }

  test("is cancelled in the very animation frame in which another view is wanted, which is asked for at once", async () => {
    const subject = await refining();
    expect([transport.requests[1]?.signal.aborted, subject.inFlight]).toEqual([false, 1]);
    subject.want(view(2), 1);
    expect(transport.requests[1]?.signal.aborted).toBe(true);
    expect([sent(), subject.inFlight]).toEqual([[1, 1, 2], 1]);
    expect(requests[1]?.fate).toBe("cancelled");
  });

  test("is told of when it fails, is no refusal that concerns a person, and is not asked for again by itself", async () => {
    const subject = await refining();
    transport.requests[1]?.fail(problem("tigas:overloaded"));
    await frame(subject, view(1));
    expect([unrefined, refusals]).toEqual([1, []]);
  });

  test("that takes seconds says nothing of how many requests to keep in flight", async () => {
    const limitAfter = async (size: ViewRequest) => {
      transport = new FakeTransport(() => now);
      const subject = pipeline();
      await frame(subject, view(1));
      transport.requests[0]?.reply();
      await frame(subject, size);
      now += 3000;
      transport.requests[1]?.reply();
      for (let x = 2; x < 40; x++) await frame(subject, view(x));
      return subject.inFlight;
    };
    const { inFlight } = await refining();
    expect(inFlight).toBe(1);
    expect(await limitAfter(refined)).toBeLessThan(await limitAfter({ ...view(1), fx: 2 }));
  });
});

describe("a picture beside the view", () => {
  const aside = view(-1, 3);

  test("neither takes the view's place nor is cancelled by it", async () => {
    const subject = pipeline();
    await frame(subject, view(1));
    const asked = subject.aside(aside);
    transport.requests[0]?.reply();
    await frame(subject, view(2));
    transport.requests[2]?.reply();
    await frame(subject, view(2));
    expect([transport.requests[1]?.signal.aborted, subject.inFlight, subject.settled]).toEqual([false, 0, true]);
    transport.requests[1]?.reply({ bytes: 700 });
    expect((await asked).arrival.bytes).toBe(700);
    expect(await frame(subject, view(2))).toBeUndefined();
  });

  test("finds room only beside what the view may have in flight", async () => {
    transport = new FakeTransport(() => now, { maxInFlight: 2 });
    const subject = pipeline();
    await frame(subject, view(1));
    expect(subject.spare).toBe(false); // until a first frame has arrived
    transport.requests[0]?.reply();
    await frame(subject, view(1));
    expect(subject.spare).toBe(true);
    await frame(subject, view(2));
    expect(subject.spare).toBe(true);
    const asked = subject.aside(aside);
    expect(subject.spare).toBe(false);
    await frame(subject, view(3));
    expect(sent()).toEqual([1, 2, -1, 3]); // the view has as much room as without
    subject.dispose();
    await expect(asked).rejects.toThrow("closed");
  });

  test("waits for a quiet moment where frames come as datagrams, of which a newer one drops the older", async () => {
    Object.assign(transport, { kind: "webtransport-datagrams" });
    const subject = pipeline();
    await frame(subject, view(1));
    transport.requests[0]?.reply();
    await frame(subject, view(1));
    expect(subject.spare).toBe(true);
    await frame(subject, view(2));
    expect(subject.spare).toBe(false);
  });
});
