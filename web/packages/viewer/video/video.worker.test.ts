import { beforeEach, expect, test, vi } from "vitest";

/** Returns pictures on demand, in any order. */
class FakeDecoder {
  static last: FakeDecoder;
  readonly output: (frame: VideoFrame) => void;
  constructor({ output }: VideoDecoderInit) {
    this.output = output;
    FakeDecoder.last = this;
  }
  configure(): void {}
  decode(): void {}
  close(): void {}
}

let answers: { readonly id: number }[];
let worker: { onmessage(event: { data: unknown }): void };

beforeEach(async () => {
  answers = [];
  vi.resetModules();
  vi.stubGlobal("VideoDecoder", FakeDecoder);
  vi.stubGlobal("EncodedVideoChunk", class {});
  vi.stubGlobal("createImageBitmap", async () => ({}));
  vi.stubGlobal("postMessage", (answer: { readonly id: number }) => answers.push(answer));
  await import("./video.worker");
  worker = globalThis as unknown as typeof worker;
});

function frame(timestamp: number): VideoFrame & { closed: boolean } {
  const made = {
    timestamp,
    closed: false,
    close() {
      made.closed = true;
    },
  };
  return made as unknown as VideoFrame & { closed: boolean };
}

test("frames are closed whether anyone still waits for them or not", async () => {
  for (const number of [0, 1]) {
    const request = { number, key: number === 0, codec: "avc1.42c01f", image: new Blob() };
    worker.onmessage({ data: { id: number, request } });
  }
  await vi.waitFor(() => expect(FakeDecoder.last).toBeDefined());
  await new Promise((resolve) => setTimeout(resolve));
  const [second, late] = [frame(1), frame(0)];
  FakeDecoder.last.output(second); // the first was skipped,
  FakeDecoder.last.output(late); // and arrives all the same
  await vi.waitFor(() => expect(answers).toHaveLength(2));
  expect([second.closed, late.closed]).toEqual([true, true]);
});
