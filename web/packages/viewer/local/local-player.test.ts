// @vitest-environment happy-dom
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { compressedPly } from "#fakes/ply";
import { steeredRig } from "#fakes/rig";
import { COURTYARD } from "#fakes/server";
import type { PresentedFrame } from "../view/presented";
import type { Rig } from "../view/rig";
import { type LocalOptions, LocalPlayer, type LocalRenderer } from "./local-player";
import { readHeader } from "./ply";
import type { RendererOptions } from "./renderer";

const FILE = compressedPly(1000, 0);
const SIZE = { width: 640, height: 360 };

/** A renderer that shows its input at once. */
class FakeRenderer {
  readonly backend = "WebGL 2";
  readonly shown: number[] = [];
  readonly streamed: string[] = [];
  streaming: Promise<void> = Promise.resolve();
  draws = 0;
  disposed = false;
  readonly options: RendererOptions;
  constructor(options: RendererOptions) {
    this.options = options;
  }
  async stream(url: string): Promise<void> {
    this.streamed.push(url);
    await this.streaming;
    this.shown.push(0);
  }
  async show(parts: readonly Uint8Array[]): Promise<void> {
    const file = new Uint8Array(parts.flatMap((part) => [...part]));
    this.shown.push(readHeader(file)?.gaussians ?? 0);
  }
  draw(): boolean {
    if (this.shown.length > 0) this.draws++;
    return this.shown.length > 0;
  }
  dispose(): void {
    this.disposed = true;
  }
}

let now: number;
let link: ReadableStreamDefaultController<Uint8Array>;
let asked: AbortSignal[];
let renderers: FakeRenderer[];
let presented: PresentedFrame[];
let received: number;
let pane: HTMLElement;
let player: LocalPlayer;

async function request(_: string, { signal }: { signal: AbortSignal }) {
  asked.push(signal);
  const body = new ReadableStream<Uint8Array>({
    start: (controller) => {
      link = controller;
    },
  });
  return new Response(body, { headers: { "content-length": String(FILE.length), etag: '"one"' } });
}

beforeEach(() => {
  vi.stubGlobal("fetch", request);
  now = 1000;
  vi.spyOn(performance, "now").mockImplementation(() => now);
  asked = [];
  renderers = [];
  presented = [];
  received = 0;
  document.body.innerHTML = "<div></div>";
  pane = document.querySelector("div") as HTMLElement;
});

afterEach(() => player.dispose());

function start(options: Partial<LocalOptions> = {}): Rig {
  const rig = steeredRig();
  rig.resize(640, 360);
  player = new LocalPlayer({
    pane,
    rig,
    scene: { ...COURTYARD, gaussians: 1000, file_bytes: FILE.length },
    form: "compressed",
    url: () => "scenes/courtyard/download/compressed",
    size: () => SIZE,
    onPresented: (frame) => presented.push(frame),
    onReceived: (bytes) => {
      received += bytes;
    },
    memory: 8,
    create: async (asks) => {
      renderers.push(new FakeRenderer(asks));
      return renderers.at(-1) as LocalRenderer;
    },
    ...options,
  });
  return rig;
}

/** A player with an answered download. */
async function downloading(): Promise<Rig> {
  const rig = start();
  await vi.waitFor(() => expect(link).toBeDefined());
  return rig;
}

const canvas = () => document.querySelector("canvas.local");
/** Waits until the download has this many bytes of the file's rows, and for all consequences. */
async function come(from: number, to: number): Promise<void> {
  const head = FILE.length - 16_000;
  link.enqueue(FILE.slice(from === 0 ? 0 : head + from, head + to));
  await vi.waitFor(() => expect(received).toBe(head + to));
  await new Promise((resolve) => setTimeout(resolve));
}

function frame(rig: Rig, after = 1000 / 60): void {
  now += after;
  player.presented(now);
  player.tick(now, rig.sample(now));
}

test("a first picture that takes seconds to draw, as if the page had been hidden, is told of", async () => {
  const rig = await downloading();
  await come(0, 16_000);
  frame(rig);
  now += 5000;
  player.resumed(5000);
  frame(rig);
  expect([player.phase.value.kind, presented.length]).toEqual(["playing", 1]);
  expect(player.stats.value.settled).toBe(true);
});

test("a first part is drawn long before the whole has come, and both times are told", async () => {
  const rig = await downloading();
  frame(rig);
  expect([player.phase.value.kind, canvas()]).toEqual(["connecting", null]);
  await come(0, 16 * 30);
  expect(renderers[0]?.shown).toEqual([20]);
  frame(rig, 500);
  frame(rig);
  expect(player.phase.value.kind).toBe("playing");
  expect(canvas()).not.toBeNull();
  await come(16 * 30, 16 * 260);
  await come(16 * 260, 16_000);
  expect(renderers[0]?.shown).toEqual([20, 250, 1000]);
  frame(rig, 2000);
  frame(rig, 300);
  const { firstPictureMs, completeMs, received: bytes, total, drawn, gaussians, backend } = player.stats.value;
  expect(firstPictureMs).toBeCloseTo(500 + 2000 / 60, 0);
  expect(completeMs).toBeGreaterThan(2500);
  expect({ bytes, total, drawn, gaussians, backend }).toEqual({
    bytes: FILE.length,
    total: FILE.length,
    drawn: 1000,
    gaussians: 1000,
    backend: "WebGL 2",
  });
  expect(player.played(1200).local).toMatchObject({
    form: "compressed",
    began_ms: -200,
    downloaded_bytes: FILE.length,
  });
});

test("frames say which pose they show, and latency counts from the first picture on", async () => {
  const rig = await downloading();
  rig.drive(() => ({ position: [now, 0, 0], quaternion: [0, 0, 0, 1] }));
  frame(rig);
  frame(rig);
  await come(0, 16_000);
  for (let i = 0; i < 4; i++) frame(rig);
  expect(presented.map(({ side, pose, width, height }) => [side, pose, width, height])).toEqual(
    [rig.pose.seq - 3, rig.pose.seq - 2, rig.pose.seq - 1].map((pose) => ["local", pose, 640, 360]),
  );
  expect(presented.at(-1)?.latencies).toEqual([expect.closeTo(1000 / 60)]);
  expect(presented[0]?.latencies).toEqual([]);
});

test("an interruption is shown, and the received part is still drawn", async () => {
  const rig = await downloading();
  await come(0, 16 * 30);
  for (let i = 0; i < 2; i++) frame(rig);
  link.error(new TypeError("network error"));
  const lost = { kind: "lost", message: "The download was interrupted." };
  await vi.waitFor(() => expect(player.phase.value).toEqual(lost));
  const before = renderers[0]?.draws ?? 0;
  frame(rig);
  expect(renderers[0]?.draws).toBe(before + 1);
  await vi.waitFor(() => expect(asked).toHaveLength(2));
});

test("a streamed scene is drawn as it arrives, counts its bytes, and is complete once the view is", async () => {
  let arrived: () => void = () => undefined;
  let transferred: (name: string, bytes: number) => void = () => undefined;
  vi.stubGlobal(
    "PerformanceObserver",
    class {
      constructor(callback: (list: { getEntries: () => object[] }) => void) {
        transferred = (name, transferSize) => callback({ getEntries: () => [{ name, transferSize }] });
      }
      observe(): void {}
      disconnect(): void {}
    },
  );
  const rig = start({
    form: "streamed",
    url: () => "http://host/scenes/courtyard/download/streamed/lod-meta.json",
    scene: { ...COURTYARD, gaussians: 500_000_000 },
    create: async (asks) => {
      const streaming = new Promise<void>((resolve) => {
        arrived = resolve;
      });
      renderers.push(Object.assign(new FakeRenderer(asks), { streaming, draw: () => true }));
      return renderers.at(-1) as LocalRenderer;
    },
  });
  await vi.waitFor(() =>
    expect(renderers[0]?.streamed).toEqual(["http://host/scenes/courtyard/download/streamed/lod-meta.json"]),
  );
  transferred("http://host/scenes/courtyard/download/streamed/0_0/means_l.webp", 5000);
  transferred("http://host/scenes/courtyard/preview.jpg", 70);
  frame(rig);
  frame(rig);
  expect([player.phase.value.kind, received]).toEqual(["playing", 5000]);
  expect(player.played(0).local).toMatchObject({ form: "streamed", downloaded_bytes: 5000, complete_ms: null });
  arrived();
  await new Promise((resolve) => setTimeout(resolve));
  frame(rig, 1000);
  expect(player.played(0).local).toMatchObject({ complete_ms: expect.any(Number), gaussians: 500_000_000 });
  expect(asked).toHaveLength(0);
});

test("a scene that is too large is not asked for", async () => {
  const rig = start({ scene: { ...COURTYARD, gaussians: 50_000_000 } });
  await vi.waitFor(() => expect(player.phase.value.kind).toBe("failed"));
  frame(rig);
  expect(player.phase.value).toMatchObject({ message: expect.stringContaining("too large for this browser") });
  expect([asked.length, renderers.length]).toEqual([0, 0]);
});

test.each<[string, Partial<LocalOptions>, string]>([
  [
    "without graphics",
    { create: () => Promise.reject(Object.assign(new Error(), { name: "NoGraphics" })) },
    "neither WebGPU nor WebGL 2",
  ],
  [
    "a renderer that fails",
    { create: () => Promise.reject(new Error("shader error")) },
    "The scene cannot be drawn in this browser: shader error.",
  ],
  [
    "a file that cannot be drawn",
    {
      create: async (asks) =>
        Object.assign(new FakeRenderer(asks), { show: () => Promise.reject(new Error("Out of memory")) }),
    },
    "The scene cannot be drawn in this browser: Out of memory.",
  ],
])("%s: one sentence, and the download ends", async (_, options, sentence) => {
  start(options);
  await vi.waitFor(() => expect(asked).toHaveLength(1));
  if (player.phase.value.kind === "connecting") link.enqueue(FILE);
  await vi.waitFor(() => expect(player.phase.value).toMatchObject({ message: expect.stringContaining(sentence) }));
  expect(asked[0]?.aborted).toBe(true);
});

test("a lost graphics processor ends it, and all is given back", async () => {
  const rig = await downloading();
  await come(0, 16 * 30);
  frame(rig);
  renderers[0]?.options.onLost();
  expect(player.phase.value).toMatchObject({ kind: "failed", message: expect.stringContaining("was lost") });
  expect([renderers[0]?.disposed, asked[0]?.aborted, canvas()]).toEqual([true, true, null]);
  frame(rig);
  expect(player.picture()).toBeNull();
});

test("leaving aborts the download and frees the renderer, also while the renderer is still being made", async () => {
  const rig = await downloading();
  await come(0, 16 * 30);
  frame(rig);
  player.dispose();
  expect([renderers[0]?.disposed, asked[0]?.aborted, canvas()]).toEqual([true, true, null]);
  let made: (renderer: LocalRenderer) => void = () => undefined;
  start({ create: () => new Promise((resolve) => (made = resolve)) });
  player.dispose();
  const late = new FakeRenderer({} as RendererOptions);
  made(late as LocalRenderer);
  await vi.waitFor(() => expect(late.disposed).toBe(true));
  expect(player.phase.value.kind).toBe("connecting");
});
