import { beforeEach, expect, test, vi } from "vitest";
import type { WorkerCall } from "#client/async/worker-calls";
import { FakeDisk } from "#fakes/opfs";
import { type SampleRequest, SampleWriter } from "./sample-writer";

let disk: FakeDisk;
let room: number;
let fails: string | null;
let asked: string[];

/** A worker that performs its requests, or fails with an error of the given name. */
class FakeWorker {
  onmessage: ((event: object) => void) | null = null;
  onerror = null;
  terminate = () => asked.push("terminate");

  postMessage({ id, request: { kind } }: WorkerCall<SampleRequest>): void {
    asked.push(kind);
    const answer = fails === null ? { id, value: 7 } : { id, error: { name: fails, message: "it broke" } };
    queueMicrotask(() => this.onmessage?.({ data: answer }));
  }
}

beforeEach(() => {
  disk = new FakeDisk();
  room = 1e9;
  fails = null;
  asked = [];
  const storage = { estimate: async () => ({ quota: room, usage: 0 }), getDirectory: async () => disk.folder };
  const locks = { request: async (_name: string, _options: object, work: (lock: object) => unknown) => work({}) };
  vi.stubGlobal("navigator", { storage, locks });
  vi.stubGlobal("Worker", FakeWorker);
});

const folders = async () => [...(await disk.root.getDirectoryHandle("samples", { create: true })).children.keys()];

test("a run gets a folder and a worker of its own", async () => {
  const writer = await SampleWriter.open(null);
  expect(await folders()).toEqual([writer.key]);
  expect(await writer.keep({} as never, new Blob(), null)).toBe(7);
  await writer.close();
  expect(asked).toEqual(["begin", "keep", "end", "terminate"]);
});

test("with too little room it does not begin", async () => {
  room = 1_000_000;
  await expect(SampleWriter.open(null)).rejects.toThrow("The browser’s storage is full.");
  expect([asked, await folders()]).toEqual([[], []]);
});

test.each([
  ["QuotaExceededError", "The browser’s storage is full."],
  ["SecurityError", "The browser stores no files for this page, as in a private window or without HTTPS."],
  ["InvalidStateError", "The browser cannot store files: it broke."],
])("what the worker meets at its beginning (%s) is a sentence, and leaves nothing", async (name, sentence) => {
  fails = name;
  await expect(SampleWriter.open(null)).rejects.toThrow(sentence);
  expect([asked, await folders()]).toEqual([["begin", "terminate"], []]);
});

test("without a secure context there are no files", async () => {
  vi.stubGlobal("navigator", {});
  await expect(SampleWriter.open(null)).rejects.toThrow("stores no files for this page");
});
