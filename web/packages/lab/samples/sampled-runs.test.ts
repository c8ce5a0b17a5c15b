import { beforeEach, expect, test, vi } from "vitest";
import type { Sample } from "#client/wire/store";
import { FakeDisk } from "#fakes/opfs";
import type { About } from "./layout";
import { SampleFiles } from "./sample-files";
import { hold, listSampledRuns, readSampledRun, removeSampledRun, samplesFolder } from "./sampled-runs";

const ABOUT: About = { experiment: "bus", run: "r", stored: false, title: "Seen", started_unix_ms: 5 };
let disk: FakeDisk;

beforeEach(() => {
  disk = new FakeDisk();
  const held = new Set<string>();
  const locks = {
    query: async () => ({ held: [...held].map((name) => ({ name })) }),
    request: async (name: string, _: object, work: (lock: object | null) => Promise<void>) => {
      if (held.has(name)) return work(null);
      held.add(name);
      return Promise.resolve(work({})).finally(() => held.delete(name));
    },
  };
  vi.stubGlobal("navigator", { storage: { getDirectory: async () => disk.folder }, locks });
});

async function sampled(key: string, about: About | null = ABOUT): Promise<SampleFiles> {
  const folder = await (await samplesFolder()).getDirectoryHandle(key, { create: true });
  const files = await SampleFiles.create(folder, about);
  await files.keep({ seq: 4, enhanced: true } as Sample, new Blob(["four"]), new Blob(["4"], { type: "image/png" }));
  await files.keep({ seq: 9, enhanced: false } as Sample, new Blob(["nine!"]), null);
  return files;
}

test("what a closed tab left is there, by what its index names", async () => {
  await sampled("a");
  const folder = await (await samplesFolder()).getDirectoryHandle("a");
  const index = (await folder.getFileHandle("samples.ndjson")) as unknown as { bytes: Uint8Array };
  index.bytes = new Uint8Array([...index.bytes, ...new TextEncoder().encode('{"seq": 1')]);
  await folder.getFileHandle("000011.jpg", { create: true });
  const [run] = await listSampledRuns();
  expect(run).toMatchObject({ key: "a", about: ABOUT, bytes: 10, busy: false });
  expect(run?.samples.map(({ seq }) => seq)).toEqual([4, 9]);
  expect([...(run?.pictures.keys() ?? [])]).toEqual(["000004.jpg", "000004.enhanced.png", "000009.jpg"]);
});

test("runs are listed by their time, also those that say nothing of themselves", async () => {
  await sampled("later", { ...ABOUT, started_unix_ms: 9 });
  await sampled("sooner");
  await sampled("unknown", null);
  expect((await listSampledRuns()).map(({ key, about }) => [key, about?.experiment])).toEqual([
    ["unknown", undefined],
    ["sooner", "bus"],
    ["later", "bus"],
  ]);
  await removeSampledRun("sooner");
  expect(await listSampledRuns()).toHaveLength(2);
  await expect(readSampledRun("sooner")).rejects.toThrow();
});

test("a run that a tab uses is busy until it lets go, and nobody else gets it", async () => {
  await sampled("a");
  const release = await hold("a");
  expect((await readSampledRun("a")).busy).toBe(true);
  expect(await hold("a")).toBeNull();
  release?.();
  await vi.waitFor(async () => expect((await readSampledRun("a")).busy).toBe(false));
  expect(await hold("a")).not.toBeNull();
});

test("a browser that keeps no files has none", async () => {
  vi.stubGlobal("navigator", {
    storage: { getDirectory: () => Promise.reject(new DOMException("", "SecurityError")) },
  });
  expect(await listSampledRuns()).toEqual([]);
});
