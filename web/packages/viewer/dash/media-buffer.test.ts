import { beforeEach, expect, test, vi } from "vitest";
import { MediaBuffer } from "./media-buffer";

/** A SourceBuffer that completes its operations on demand. */
class FakeSource extends EventTarget {
  updating = false;
  /** Its operations, in order. */
  readonly asked: string[] = [];
  ranges: [start: number, end: number][] = [];
  /** Accepts no more bytes. */
  full = false;
  /** Whether it was removed from its player. */
  removed = false;

  get buffered() {
    if (this.removed) throw new DOMException("", "InvalidStateError");
    return {
      length: this.ranges.length,
      start: (index: number) => this.ranges[index]?.[0] ?? Number.NaN,
      end: (index: number) => this.ranges[index]?.[1] ?? Number.NaN,
    };
  }

  appendBuffer(bytes: Uint8Array): void {
    if (this.full) throw new DOMException("", "QuotaExceededError");
    this.#begin(`append ${bytes.join()}`);
  }

  remove(start: number, end: number): void {
    this.#begin(`remove ${start} to ${end}`);
  }

  abort(): void {
    this.asked.push("abort");
  }

  finish(): void {
    this.updating = false;
    this.dispatchEvent(new Event("updateend"));
  }

  #begin(what: string): void {
    if (this.updating) throw new DOMException("", "InvalidStateError");
    this.updating = true;
    this.asked.push(what);
  }
}

let source: FakeSource;
let leaving: AbortController;
let position: number;
let failed: string[];
let onAppended: ReturnType<typeof vi.fn<() => void>>;
let buffer: MediaBuffer;

beforeEach(() => {
  source = new FakeSource();
  leaving = new AbortController();
  position = 0;
  failed = [];
  onAppended = vi.fn<() => void>();
  buffer = new MediaBuffer({
    source: source as unknown as SourceBuffer,
    signal: leaving.signal,
    position: () => position,
    onAppended,
    onFailed: (reason) => failed.push(reason),
  });
});

function append(...values: number[]): void {
  buffer.append(Uint8Array.from(values));
}

test("bytes that come while the source works wait, and keep their order", () => {
  append(1);
  append(2);
  append(3);
  expect(source.asked).toEqual(["append 1"]);
  source.finish();
  source.finish();
  expect(source.asked).toEqual(["append 1", "append 2", "append 3"]);
  expect(onAppended).toHaveBeenCalledTimes(2);
  source.ranges = [
    [0, 1],
    [2, 2.5],
  ];
  expect(buffer.end).toBe(2.5);
});

test("half a box is forgotten before what follows an interruption, and so is what waited", () => {
  append(1);
  append(2);
  buffer.interrupt();
  append(3);
  source.finish();
  source.finish();
  append(4);
  expect(source.asked).toEqual(["append 1", "abort", "append 3", "append 4"]);
});

test("what was played is forgotten", () => {
  source.ranges = [[10, 20.1]];
  position = 20;
  append(1);
  source.finish();
  position = 20.5;
  append(2);
  expect(source.asked).toEqual(["append 1", "remove 0 to 15.5"]);
  source.ranges = [[15.5, 20.6]];
  source.finish();
  expect(source.asked.at(-1)).toBe("append 2");
});

test("a source that is full gives up all that was played; if that does not help, the stream fails", () => {
  source.ranges = [[0, 3]];
  position = 2;
  source.full = true;
  append(1);
  expect(source.asked).toEqual(["remove 0 to 2"]);
  source.full = false;
  source.finish();
  expect(source.asked.at(-1)).toBe("append 1");
  source.finish();
  source.full = true;
  append(2);
  source.finish();
  expect(failed).toEqual(["The player stopped: the browser cannot buffer any more of the stream."]);
});

test("a source that has left is not looked at, whatever still comes", () => {
  append(1);
  leaving.abort();
  source.removed = true;
  source.finish(); // the operation in progress when it was closed
  source.dispatchEvent(new Event("error"));
  append(2);
  expect(buffer.end).toBeNull();
  expect(source.asked).toEqual(["append 1"]);
  expect(onAppended).not.toHaveBeenCalled();
  expect(failed).toEqual([]);
});

test("a stream that the source cannot read fails", () => {
  source.dispatchEvent(new Event("error"));
  expect(failed).toHaveLength(1);
});
