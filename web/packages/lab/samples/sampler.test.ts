import { expect, test } from "vitest";
import { type Deferred, deferred } from "#client/async/deferred";
import type { Sample } from "#client/wire/store";
import { settle } from "#fakes/transport";
import type { ShownFrame } from "#viewer/stateless/stateless-player";
import { SamplesRefused } from "./sample-writer";
import { Sampler } from "./sampler";

const ASKED = { scene: "hall", profile: 2, fx: 1, fy: 1, cx: 1, cy: 1, width: 1280, height: 720 };
const frame = (seq: number, at = 1000 + 20 * seq): ShownFrame => ({
  at,
  asked: { ...ASKED, seq },
  header: { status: 200, seq, content_type: "image/jpeg", width: 640, height: 360, profile: 2, timing: null },
  image: new Blob(["x".repeat(seq)]),
  enhanced: null,
});

/** A writer that stores only the samples that a test allows. */
class FakeWriter {
  readonly key = "a-run";
  readonly kept: Sample[] = [];
  readonly pictures: (ImageBitmap | null)[] = [];
  readonly waiting: Deferred<number>[] = [];
  closed = false;

  keep(sample: Sample, _jpeg: Blob, picture: ImageBitmap | null): Promise<number> {
    this.kept.push(sample);
    this.pictures.push(picture);
    const waiting = deferred<number>();
    this.waiting.push(waiting);
    return waiting.promise;
  }

  async close(): Promise<void> {
    this.closed = true;
  }

  async write(): Promise<void> {
    for (const { resolve } of this.waiting.splice(0)) resolve(1);
    await settle();
  }
}

async function sampling(stride: number) {
  const writer = new FakeWriter();
  const sampler = await Sampler.open(null, stride, async () => writer);
  return { writer, sampler };
}

test("every third frame is kept, from the run's start on, with what was asked for", async () => {
  const { writer, sampler } = await sampling(3);
  sampler.shown(frame(1));
  sampler.begin(1050);
  for (let seq = 3; seq < 10; seq++) sampler.shown(frame(seq));
  await writer.write();
  expect(writer.kept.map(({ seq, at }) => [seq, at])).toEqual([
    [3, 10],
    [6, 70],
    [9, 130],
  ]);
  expect(writer.pictures).toEqual([null, null, null]);
  expect(writer.kept[0]).toMatchObject({ enhanced: false, upscale: "off", enhance_ms: null });
  expect(writer.kept[0]).toMatchObject({ request: { ...ASKED, seq: 3 }, rung: 2, bytes: 3, width: 640, height: 360 });
  expect(await sampler.finish()).toEqual({ key: "a-run", kept: 3, missed: 0, problem: null });
  expect(writer.closed).toBe(true);
});

test("of a frame that was enhanced, the picture that is on the screen is kept, too", async () => {
  const { writer, sampler } = await sampling(2);
  const copied: number[] = [];
  const picture = { width: 1280 } as ImageBitmap;
  const enhanced = (seq: number) => ({
    ...frame(seq),
    enhanced: {
      width: 1280,
      height: 720,
      ms: 4.5,
      restore: "off",
      upscale: "scene",
      copy: () => {
        copied.push(seq);
        if (seq === 5) throw new Error("the frame was released");
        return picture;
      },
    },
  });
  sampler.begin(0);
  for (let seq = 1; seq <= 5; seq++) sampler.shown(enhanced(seq));
  await writer.write();
  expect(copied).toEqual([1, 3, 5]);
  expect(writer.pictures).toEqual([picture, picture]);
  expect(writer.kept[1]).toMatchObject({
    seq: 3,
    restore: "off",
    upscale: "scene",
    enhance_ms: 4.5,
    width: 1280,
    height: 720,
    enhanced: true,
  });
  expect(await sampler.finish()).toMatchObject({ kept: 2, missed: 1 });
});

test("it ends once everything is written", async () => {
  const { writer, sampler } = await sampling(1);
  sampler.begin(0);
  sampler.shown(frame(1));
  let ended = false;
  const end = sampler.finish().finally(() => {
    ended = true;
  });
  await settle();
  expect(ended).toBe(false);
  await writer.write();
  expect(await end).toMatchObject({ kept: 1 });
});

test("a disk that is too slow costs samples, not memory", async () => {
  const { writer, sampler } = await sampling(1);
  sampler.begin(0);
  for (let seq = 1; seq <= 20; seq++) sampler.shown(frame(seq));
  expect(writer.kept).toHaveLength(16);
  await writer.write();
  sampler.shown(frame(21));
  await writer.write();
  expect(await sampler.finish()).toMatchObject({ kept: 17, missed: 4, problem: null });
});

test("a number that was there before, as after a new connection, is no second sample's", async () => {
  const { writer, sampler } = await sampling(1);
  sampler.begin(0);
  for (const seq of [1, 2, 1, 3]) sampler.shown(frame(seq));
  await writer.write();
  expect(writer.kept.map(({ seq }) => seq)).toEqual([1, 2, 3]);
  expect(await sampler.finish()).toMatchObject({ kept: 3, missed: 1 });
});

test("a full disk ends sampling with a sentence, and what was kept stays", async () => {
  const { writer, sampler } = await sampling(1);
  sampler.begin(0);
  sampler.shown(frame(1));
  await writer.write();
  sampler.shown(frame(2));
  writer.waiting[0]?.reject(new SamplesRefused("The browser’s storage is full."));
  await settle();
  sampler.shown(frame(3));
  expect(writer.kept).toHaveLength(2);
  expect(await sampler.finish()).toEqual({
    key: "a-run",
    kept: 1,
    missed: 0,
    problem: "The browser’s storage is full. Sampling ended after 1 frames.",
  });
});

test("where nothing can be kept, a run goes on without samples", async () => {
  const refused = new SamplesRefused("The browser stores no files.");
  const sampler = await Sampler.open(null, 1, () => Promise.reject(refused));
  sampler.begin(0);
  sampler.shown(frame(1));
  expect(await sampler.finish()).toEqual({
    key: null,
    kept: 0,
    missed: 0,
    problem: "The browser stores no files. Nothing was sampled.",
  });
});
