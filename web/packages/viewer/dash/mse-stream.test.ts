// @vitest-environment happy-dom
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { type Stream, StreamUnsupported } from "../stream/stream";
import { playStream } from "./mse-stream";

const MPD = `<?xml version="1.0" encoding="utf-8"?>
<MPD xmlns="urn:mpeg:dash:schema:mpd:2011" availabilityStartTime="1970-01-01T00:00:00.000Z">
  <ServiceDescription><Latency target="60" /></ServiceDescription>
  <SegmentTemplate timescale="1000" duration="1000" startNumber="1" initialization="$RepresentationID$/init"
    media="$RepresentationID$/$Number$" />
  <Representation id="low" bandwidth="500000" codecs="avc1.42c00d" />
  <Representation id="high" bandwidth="4000000" codecs="avc1.42c01e" />
  <UTCTiming value="http://packager/time" />
</MPD>`;

/** The parts of a browser needed for playback. */
class FakeVideo extends EventTarget {
  src = "";
  currentTime = 0;
  playbackRate = 1;
  seeking = false;
  error: { message: string } | null = null;
  readonly play = vi.fn(async () => undefined);
  readonly load = vi.fn(() => undefined);
  removeAttribute(): void {
    this.src = "";
  }
}

class FakeSource extends EventTarget {
  updating = false;
  readonly mime: string;
  /** The end of the buffer. */
  end: number | undefined;
  constructor(mime: string) {
    super();
    this.mime = mime;
  }
  get buffered() {
    return { length: this.end === undefined ? 0 : 1, start: () => (this.end ?? 0) - 1, end: () => this.end };
  }
  appendBuffer(): void {
    this.updating = true;
  }
  /** Completes an append. */
  has(end: number): void {
    this.updating = false;
    this.end = end;
    this.dispatchEvent(new Event("updateend"));
  }
}

class FakeMedia extends EventTarget {
  static readonly isTypeSupported = () => true;
  duration = 0;
  constructor() {
    super();
    queueMicrotask(() => this.dispatchEvent(new Event("sourceopen")));
  }
  addSourceBuffer(mime: string): FakeSource {
    source = new FakeSource(mime);
    media = this;
    return source;
  }
}

let source: FakeSource;
let media: FakeMedia;
let video: FakeVideo;
let failed: string[];
let status: number;
let stream: Stream;

beforeEach(() => {
  vi.useFakeTimers({ now: 0, toFake: ["setTimeout", "clearTimeout", "setInterval", "clearInterval", "performance"] });
  video = new FakeVideo();
  failed = [];
  status = 200;
  vi.stubGlobal("MediaSource", FakeMedia);
  vi.stubGlobal("URL", Object.assign(URL, { createObjectURL: () => "blob:media", revokeObjectURL: () => undefined }));
  vi.stubGlobal("fetch", async (url: string) => {
    if (url.endsWith(".mpd")) return new Response(MPD, { status });
    // The server is a minute ahead of the page.
    if (url.endsWith("/time")) return new Response(new Date(60_000 + performance.now()).toISOString());
    return new Response(new Uint8Array(8));
  });
});

afterEach(() => {
  stream.dispose();
  vi.useRealTimers();
});

async function play(): Promise<void> {
  stream = playStream(video as unknown as HTMLVideoElement, "http://packager/a/manifest.mpd", {
    received: () => undefined,
    failed: (reason) => failed.push(reason),
  });
  await vi.advanceTimersByTimeAsync(0);
}

test("it begins just before the end of what has come, and goes on at the manifest's target", async () => {
  await play();
  expect(source.mime).toBe('video/mp4; codecs="avc1.42c01e"'); // a decoder of the best representation can decode them all
  expect(media.duration).toBe(Number.POSITIVE_INFINITY);
  expect(stream.latency()).toBeNull();
  expect(video.play).not.toHaveBeenCalled();
  source.has(59.98);
  expect(video.play).toHaveBeenCalledOnce();
  expect(video.currentTime).toBeCloseTo(59.96);
  expect(stream.latency()).toBeCloseTo(0.04);
  await vi.advanceTimersByTimeAsync(100); // the video has stopped, so it falls behind
  source.has(60.08);
  expect(video.playbackRate).toBe(1.05);
  stream.aim(300);
  await vi.advanceTimersByTimeAsync(50);
  expect(video.playbackRate).toBe(0.95);
});

test("after a stall it jumps to the end, unless it is under way to somewhere", async () => {
  await play();
  source.has(60);
  await vi.advanceTimersByTimeAsync(2000);
  expect(video.currentTime).toBeCloseTo(59.98);
  video.seeking = true;
  source.has(61.98);
  expect(video.currentTime).toBeCloseTo(59.98);
  video.seeking = false;
  await vi.advanceTimersByTimeAsync(50);
  expect(video.currentTime).toBeCloseTo(61.96);
});

test("a session that has ended and a video that cannot be decoded end it", async () => {
  status = 404;
  await play();
  expect(failed).toEqual(["The DASH stream has ended."]);
  status = 200;
  await play();
  video.error = { message: "PIPELINE_ERROR_DECODE" };
  video.dispatchEvent(new Event("error"));
  expect(failed[1]).toBe("The player stopped: PIPELINE_ERROR_DECODE");
});

test("leaving restores the video element", async () => {
  await play();
  source.has(60);
  video.playbackRate = 1.05;
  stream.dispose();
  expect([video.src, video.playbackRate]).toEqual(["", 1]);
  await vi.advanceTimersByTimeAsync(5000);
  expect(failed).toEqual([]);
});

test.each([
  ["Media Source Extensions", undefined],
  ["H.264", { isTypeSupported: () => false }],
])("a browser without %s is told so", async (missing, extensions) => {
  await play();
  vi.stubGlobal("MediaSource", extensions);
  const start = () => playStream(video as unknown as HTMLVideoElement, "", { received: vi.fn(), failed: vi.fn() });
  expect(start).toThrow(StreamUnsupported);
  expect(start).toThrow(missing);
});
