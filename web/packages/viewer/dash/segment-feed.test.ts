import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { Manifest, Representation } from "./manifest";
import { SegmentFeed } from "./segment-feed";

const LOW: Representation = { id: "low", bandwidth: 500_000, codecs: "avc1" };
const HIGH: Representation = { id: "high", bandwidth: 4_000_000, codecs: "avc1" };
const MANIFEST: Manifest = {
  start: 0,
  segment: 1,
  firstNumber: 1,
  timeUrl: "time",
  target: 60,
  representations: [LOW, HIGH],
  headerUrl: ({ id }) => `${id}/init`,
  segmentUrl: ({ id }, number) => `${id}/${number}`,
};
/** A chunk that is complete at once: an empty `mdat` box. */
const CHUNK = Uint8Array.from([0, 0, 0, 8, ...new TextEncoder().encode("mdat")]);

/** Requests, in order. */
let asked: string[];
/** For each requested segment: sends bytes, or ends it. */
let segments: Map<string, ReadableStreamDefaultController<Uint8Array>>;
/** Answers that replace a segment. */
let answers: Map<string, () => Response>;
let heard: string[];
let visit: AbortController;
let ended: Promise<string>;

beforeEach(() => {
  vi.useFakeTimers({ now: 0, toFake: ["setTimeout", "clearTimeout", "performance"] });
  asked = [];
  segments = new Map();
  answers = new Map();
  heard = [];
  visit = new AbortController();
  vi.stubGlobal("fetch", async (path: string, { signal }: RequestInit) => {
    asked.push(path);
    signal?.throwIfAborted();
    const answer = answers.get(path);
    if (answer) return answer();
    if (path.endsWith("init")) return new Response(Uint8Array.from([path.length]));
    const body = new ReadableStream<Uint8Array>({
      start: (controller) => {
        segments.set(path, controller);
        signal?.addEventListener("abort", () => controller.error(signal.reason));
      },
    });
    return new Response(body);
  });
});

afterEach(() => {
  visit.abort();
  vi.useRealTimers();
});

/** Opens a viewer when the stream is this old, in milliseconds. */
async function watch(age: number): Promise<void> {
  await vi.advanceTimersByTimeAsync(age);
  const feed = new SegmentFeed({
    manifest: MANIFEST,
    live: () => performance.now() / 1000,
    onBytes: (bytes) => heard.push(bytes.length === 1 ? "header" : "bytes"),
    onInterrupted: () => heard.push("interrupted"),
    onReceived: () => undefined,
  });
  ended = feed.run(visit.signal).catch((error: Error) => error.message);
  await vi.advanceTimersByTimeAsync(0);
}

async function send(segment: string, after = 0): Promise<void> {
  await vi.advanceTimersByTimeAsync(after);
  segments.get(segment)?.enqueue(CHUNK);
  await vi.advanceTimersByTimeAsync(0);
}

async function end(segment: string): Promise<void> {
  segments.get(segment)?.close();
  await vi.advanceTimersByTimeAsync(0);
}

test("it begins with the segment that grows, and asks for the next one before that begins", async () => {
  await watch(7200);
  expect(asked).toEqual(["low/8", "low/init"]);
  await send("low/8");
  await vi.advanceTimersByTimeAsync(290);
  expect(asked).toHaveLength(2);
  await vi.advanceTimersByTimeAsync(20); // half a second before segment 9
  expect(asked).toHaveLength(3);
  expect(heard).toEqual(["header", "bytes"]);
});

test("quality changes from segment to segment, with the header of its representation", async () => {
  await watch(7200);
  await send("low/8"); // at once, so that the link is fast
  await vi.advanceTimersByTimeAsync(400);
  expect(asked.at(-1)).toBe("high/9");
  await send("low/8", 380);
  await end("low/8");
  expect(asked.at(-1)).toBe("high/init");
  await send("high/9", 200);
  expect(heard).toEqual(["header", "bytes", "bytes", "header", "bytes"]);
});

test("bytes of a segment that was left behind are given up for the newest", async () => {
  await watch(7200);
  await send("low/8");
  await send("low/8", 2000); // an outage: segment 10 is growing by now
  expect(heard.slice(0, 4)).toEqual(["header", "bytes", "bytes", "interrupted"]);
  await send("high/10");
  expect(heard.slice(4)).toEqual(["header", "bytes"]);
});

test("a request that fails on its way is tried again, a few times", async () => {
  let fails = 2;
  answers.set("low/8", () => {
    if (fails-- > 0) throw new TypeError("Failed to fetch");
    return new Response(CHUNK);
  });
  await watch(7000);
  await vi.advanceTimersByTimeAsync(600);
  expect(heard.slice(0, 4)).toEqual(["interrupted", "interrupted", "header", "bytes"]);
  vi.stubGlobal("fetch", () => Promise.reject(new TypeError("Failed to fetch")));
  segments.get("high/9")?.error(new TypeError("network error"));
  await vi.advanceTimersByTimeAsync(10_000);
  expect(await ended).toBe("The DASH stream was interrupted.");
});

test("a stream ends with its session", async () => {
  answers.set("low/8", () => new Response(null, { status: 404 }));
  await watch(7000);
  expect(await ended).toBe("The DASH stream has ended.");
});

test("leaving aborts open requests", async () => {
  await watch(7600);
  visit.abort(new Error("left"));
  expect(await ended).toBe("left");
  const before = asked.length;
  await vi.advanceTimersByTimeAsync(5000);
  expect(asked).toHaveLength(before);
});
