import { beforeEach, describe, expect, test, vi } from "vitest";
import { FrameDropped, type FrameReply, type FrameTransport } from "#client/transport/transport";
import type { RenderRequest } from "#client/wire/render";
import { FakeDecoder } from "#fakes/decoder";
import { FakeTransport, settle } from "#fakes/transport";
import { SKIPPED } from "./encoded-frame";
import { VideoFrames, videoProblem } from "./video-frames";

const PATIENCE = 100;
const never = new AbortController().signal;

let now: number;
let worker: FakeDecoder;
let frames: VideoFrames;
let transport: FakeTransport;
let over: FrameTransport;

beforeEach(() => {
  now = 0;
  vi.spyOn(performance, "now").mockImplementation(() => now);
  worker = new FakeDecoder();
  frames = new VideoFrames(() => worker, Promise.resolve(null));
  transport = new FakeTransport(() => now, { kind: "webtransport-streams" });
  over = frames.over(transport);
});

const VIDEO = { bitrate_kbps: 1000, frames_per_s: 60 };
const request = (seq: number): RenderRequest => ({
  ...{ scene: "s", seq, fx: 1, fy: 1, cx: 1, cy: 1, width: 2, height: 2 },
  ...({ format: "h264", video: VIDEO } as const),
});
/** A received frame; without `after`, a key frame. */
function frame(seq: number, after: number | null = null): FrameReply {
  const video = { key: after === null, after, codec: "avc1.42c01f" };
  const header = { status: 200, seq, content_type: "video/h264", video };
  return { header, image: new Blob(), arrival: { sentAt: 0, firstByteAt: 0, lastByteAt: 0, bytes: 1, sharedBytes: 0 } };
}
/** Outcome of a frame: `shown`, or the error. */
const fate = (reply: FrameReply, signal = never) =>
  frames.decode(reply, signal).then(
    () => "shown",
    (error: Error) => error.message,
  );
const asked = () => transport.requests.map((one) => one.request.video?.key ?? false);
const send = (seq: number) => void over.request(request(seq), never).catch(() => undefined);

describe("asking", () => {
  test("begins with a key frame, and leaves other requests as they are", async () => {
    send(0);
    send(1);
    void over.request({ ...request(2), format: "jpeg", video: null }, never);
    expect(asked()).toEqual([true, false, false]);
    expect(transport.requests[0]?.request.video).toEqual({ ...VIDEO, key: true });
  });

  test("goes on without once it came, and begins anew on another connection", async () => {
    send(0);
    await fate(frame(0));
    send(1);
    transport = new FakeTransport(() => now, { kind: "webtransport-streams" });
    over = frames.over(transport);
    send(2);
    expect(asked()).toEqual([true]);
    expect(frames.keyFrames).toBe(0);
  });

  test("is never taken back while frames that come are of use, as others may refer to them", () => {
    const abort = new AbortController();
    void over.request(request(0), abort.signal).catch(() => undefined);
    abort.abort(new FrameDropped("a newer frame is on the screen"));
    expect(transport.requests[0]?.signal.aborted).toBe(false);
    frames.reset();
    expect(transport.requests[0]?.signal.aborted).toBe(true);
  });

  test("asks again after a request for a key frame was refused", async () => {
    send(0);
    transport.requests[0]?.fail(new FrameDropped("superseded"));
    await settle();
    send(1);
    expect(asked()).toEqual([true, true]);
  });
});

test("leaving the mode gives the decoder back", async () => {
  send(0);
  await fate(frame(0));
  frames.dispose();
  expect(worker.terminated).toBe(true);
});

describe("decoding", () => {
  test("follows the chain, whatever order frames come in, and one that nobody wants any more is decoded, too", async () => {
    const abort = new AbortController();
    abort.abort(new FrameDropped("overtaken"));
    const fates = [fate(frame(0)), fate(frame(2, 1)), fate(frame(1, 0), abort.signal)];
    expect(await Promise.all(fates)).toEqual(["shown", "shown", "overtaken"]);
    expect(worker.decoded.map(({ number, key }) => [number, key])).toEqual([
      [0, true],
      [1, false],
      [2, false],
    ]);
    expect(worker.pictures.map(({ closed }) => closed)).toEqual([false, true, false]);
  });

  test("waits for a missing frame no longer than it should, shows none without it, and asks for a key frame", async () => {
    await fate(frame(0));
    const orphan = fate(frame(2, 1));
    now += PATIENCE;
    frames.tick(PATIENCE);
    send(3);
    now += 1;
    frames.tick(PATIENCE);
    send(4);
    expect(await orphan).toContain("missing");
    expect(asked()).toEqual([false, true]);
    expect(worker.decoded).toHaveLength(1);
    expect(await fate(frame(4))).toBe("shown");
    expect(frames.keyFrames).toBe(2);
  });

  test("begins anew with a key frame after a failure of the decoder, and not for a frame that it left out", async () => {
    await fate(frame(0));
    worker.failure = { name: SKIPPED, message: "" };
    await fate(frame(1, 0));
    send(2);
    worker.failure = { name: "EncodingError", message: "Decoding error." };
    await Promise.all([fate(frame(2, 1)), fate(frame(3, 2))]);
    send(4);
    expect(asked()).toEqual([false, true]);
    worker.failure = null;
    expect(await fate(frame(4))).toBe("shown");
    expect(frames.problem.value).toBeNull();
  });

  test("gives up in a sentence when the decoder keeps failing", async () => {
    worker.failure = { name: "EncodingError", message: "Decoding error." };
    for (let seq = 0; seq < 4; seq++) {
      expect(frames.problem.value).toBeNull();
      await fate(frame(seq));
      now += 1000;
    }
    expect(frames.problem.value).toContain("keeps failing (Decoding error)");
  });

  test("bears with failures that come now and then", async () => {
    worker.failure = { name: "EncodingError", message: "Decoding error." };
    for (let seq = 0; seq < 8; seq++) {
      await fate(frame(seq));
      now += 5000;
    }
    expect(frames.problem.value).toBeNull();
  });
});

test.each(["fetch", "webtransport-datagrams"] as const)("over %s one sentence says that it needs streams", (kind) => {
  frames.over(new FakeTransport(() => now, { kind }));
  expect(frames.problem.value).toContain("needs WebTransport,");
  frames.over(transport);
  expect(frames.problem.value).toBeNull();
});

test("pictures that arrive after the viewer has closed are closed", async () => {
  await fate(frame(0));
  const waiting = fate(frame(2, 1));
  frames.dispose();
  expect(await waiting).toContain("missing");
  expect(worker.terminated).toBe(true);
});

describe("support", () => {
  const decoder = (isConfigSupported: () => Promise<{ supported: boolean }>) =>
    vi.stubGlobal("VideoDecoder", { isConfigSupported });

  test.each([
    ["without WebCodecs", () => vi.stubGlobal("isSecureContext", true), "no WebCodecs"],
    ["on an insecure page", () => vi.stubGlobal("isSecureContext", false), "only over HTTPS"],
    ["without H.264", () => decoder(async () => ({ supported: false })), "cannot decode H.264"],
    ["with a decoder that cannot be asked", () => decoder(() => Promise.reject(new TypeError("no"))), "H.264"],
  ])("%s one sentence says so, and names the way out", async (_, set, sentence) => {
    set();
    const problem = await videoProblem();
    expect(problem).toContain(sentence);
    expect(problem).toContain("Choose another mode.");
  });

  test("where the decoder takes it, there is nothing to say", async () => {
    decoder(async () => ({ supported: true }));
    expect(await videoProblem()).toBeNull();
  });
});
