import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import type { Sample } from "#client/wire/store";
import type { SampledRun } from "../samples/sampled-runs";
import { deleteSamples, type SampleStore, uploadSamples } from "./sample-upload";

const { runs, held, described } = vi.hoisted(() => ({
  runs: new Map<string, unknown>(),
  held: new Set<string>(),
  described: [] as object[],
}));
vi.mock("../samples/sampled-runs", () => ({
  hold: async (key: string) => {
    if (held.has(key)) return null;
    held.add(key);
    return () => held.delete(key);
  },
  readSampledRun: async (key: string) => runs.get(key),
  removeSampledRun: async (key: string) => runs.delete(key),
}));
vi.mock("../samples/sample-writer", () => ({
  describeSamples: async (key: string, about: object) => {
    described.push(about);
    runs.set(key, { ...(runs.get(key) as object), about });
  },
}));

const picture = (bytes: number) => new File(["x".repeat(bytes)], "a");
let store: SampleStore & { pictures: Map<string, number>; complete: boolean; refuses: number };
let told: [number, number][];

beforeEach(() => {
  runs.clear();
  held.clear();
  described.length = 0;
  told = [];
  const pictures = new Map<string, number>();
  store = {
    pictures,
    complete: false,
    refuses: Number.POSITIVE_INFINITY,
    add: vi.fn(async () => ({}) as never),
    uploadedSamples: async () => ({
      complete: store.complete,
      files: [...pictures].map(([name, bytes]) => ({ name, bytes })),
    }),
    addPicture: vi.fn(async (_id, _run, name, { size }) => {
      if (pictures.size >= store.refuses) throw new ApiError("The store is not responding.", true);
      pictures.set(name, size);
    }),
    completeSamples: vi.fn(async () => {
      store.complete = true;
    }),
  };
});

afterEach(() => {
  vi.clearAllMocks();
});

function sampled(about: object | null, samples = [{ seq: 1 }, { seq: 2 }] as Sample[]): void {
  const pictures = new Map(samples.map(({ seq }) => [`00000${seq}.jpg`, picture(10 * seq)]));
  const run = { key: "k", about, samples, pictures, bytes: 30, busy: false };
  runs.set("k", run as SampledRun);
}

const ABOUT = { experiment: "e7", run: "r", stored: false, title: "Seen", started_unix_ms: 5 };

function uploaded({ signal = new AbortController().signal, stored = false } = {}) {
  return uploadSamples({ key: "k", stored, store, progress: (sent, of) => told.push([sent, of]), signal });
}

test("pictures come first, then which samples there are; then they are gone from here", async () => {
  sampled(ABOUT);
  await uploaded({ stored: true });
  expect(store.pictures).toEqual(
    new Map([
      ["000001.jpg", 10],
      ["000002.jpg", 20],
    ]),
  );
  expect(store.completeSamples).toHaveBeenCalledWith("e7", "r", [{ seq: 1 }, { seq: 2 }]);
  expect(told).toEqual([
    [0, 30],
    [10, 30],
    [30, 30],
  ]);
  expect([runs.size, held.size]).toEqual([0, 0]);
  expect(store.add).not.toHaveBeenCalled();
});

test("an upload that was cut off goes on where it was, in the same place", async () => {
  sampled(ABOUT);
  store.refuses = 1;
  await expect(uploaded()).rejects.toThrow("The store is not responding.");
  expect([runs.size, held.size]).toEqual([1, 0]);
  store.refuses = 9;
  vi.mocked(store.addPicture).mockClear();
  await uploaded();
  expect(vi.mocked(store.addPicture).mock.calls.map(([id, run, name]) => [id, run, name])).toEqual([
    ["e7", "r", "000002.jpg"],
  ]);
  expect(runs.size).toBe(0);
});

test("what the store completed, although its answer was lost, is not sent again", async () => {
  sampled({ ...ABOUT, stored: true });
  store.complete = true;
  await uploaded();
  expect(store.addPicture).not.toHaveBeenCalled();
  expect(runs.size).toBe(0);
});

test("samples of a run that was never ended get a failed run, once", async () => {
  sampled(ABOUT);
  store.refuses = 0;
  await expect(uploaded()).rejects.toThrow();
  store.refuses = 9;
  await uploaded();
  expect(vi.mocked(store.add).mock.calls).toEqual([
    ["e7", "r", { problem: "The page was closed before the run's end; only its samples are left." }],
  ]);
  expect(store.completeSamples).toHaveBeenCalledWith("e7", "r", expect.anything());
});

test("samples whose run another page has completed stay here, and the reason is said", async () => {
  sampled(ABOUT);
  vi.mocked(store.add).mockRejectedValueOnce(new ApiError("The run r is complete already.", false));
  await expect(uploaded()).rejects.toThrow("The run r is complete already.");
  expect([store.pictures.size, runs.size]).toEqual([0, 1]);
});

test("what another tab uses is left alone", async () => {
  sampled(ABOUT);
  held.add("k");
  await expect(uploaded()).rejects.toThrow("Another tab is using them.");
  await expect(deleteSamples("k")).rejects.toThrow("Another tab is using them.");
  expect(runs.size).toBe(1);
  held.clear();
  await deleteSamples("k");
  expect(runs.size).toBe(0);
});

test("without any sample there is nothing to upload, and of unknown ones nobody knows where", async () => {
  sampled(null);
  await expect(uploaded()).rejects.toThrow("Their run is unknown.");
  sampled(ABOUT, []);
  await uploaded();
  expect(store.add).not.toHaveBeenCalled();
  expect(runs.size).toBe(0);
});

test("cancelling ends it between two pictures, and loses nothing", async () => {
  sampled(ABOUT);
  const cancel = new AbortController();
  vi.mocked(store.addPicture).mockImplementationOnce(async () => cancel.abort(new Error("cancelled")));
  await expect(uploaded({ signal: cancel.signal })).rejects.toThrow("cancelled");
  expect(store.addPicture).toHaveBeenCalledTimes(1);
  expect([runs.size, held.size]).toEqual([1, 0]);
});
