import { beforeEach, expect, test } from "vitest";
import type { ScenePose } from "../view/camera";
import { WalkQuality } from "./walk-quality";

/** Number of open pictures. */
let open: number;
let asked: number[];
let refuse: (pose: number) => boolean;
let quality: WalkQuality;

class FakePicture {
  readonly value: number;
  constructor(value: number) {
    this.value = value;
    open++;
  }
  close() {
    open--;
  }
}

const picture = (value: number) => new FakePicture(value) as unknown as ImageBitmap;
const shownBy = (one: ImageBitmap | null) => (one as unknown as FakePicture | null)?.value ?? 0;
const at = (x: number): ScenePose => ({ position: [x, 0, 0], quaternion: [0, 0, 0, 1] });

beforeEach(() => {
  open = 0;
  asked = [];
  refuse = () => false;
  quality = new WalkQuality({
    truth: async ({ position: [x] }) => {
      asked.push(x);
      if (refuse(x)) throw new Error("The server is full.");
      return picture(x);
    },
    compare: (pictures, truth) => pictures.map((one) => shownBy(one) - shownBy(truth)),
  });
});

/** Samples a walk at the given rate and length in seconds; the right side lags by 1, and shows nothing at first. */
function walk(seconds: number): void {
  for (let now = 0; now <= seconds * 1000; now += 250) {
    const x = now / 1000;
    quality.walked(at(x), () => [Promise.resolve(picture(x)), x < 1 ? null : Promise.resolve(picture(x - 1))], now);
  }
}

async function scores(signal = new AbortController().signal) {
  const all = [];
  for await (const score of quality.scores(signal)) all.push(score);
  return all;
}

test("each moment's pictures are held against the view that was due then, one truth for all sides", async () => {
  walk(2);
  expect(asked).toEqual([]); // nothing during a walk
  const all = await scores();
  expect(asked).toEqual([0, 0.5, 1, 1.5, 2]);
  expect(all.map(({ moments }) => moments)).toEqual([1, 2, 3, 4, 5]);
  expect(all.at(-1)?.psnr).toEqual([0, (0 - 0.5 - 1 - 1 - 1) / 5]);
  expect(open).toBe(0);
});

test("of a long walk few moments are kept, evenly over all of it", async () => {
  walk(20);
  await scores();
  expect(asked).toEqual([0, 4, 8, 12, 16, 20]);
  expect(open).toBe(0);
});

test("the next walk begins as the first did", async () => {
  walk(20);
  await scores();
  asked = [];
  walk(1);
  await scores();
  expect(asked).toEqual([0, 0.5, 1]);
});

test("where truth ends, what there is counts; where there is none, the reason is told", async () => {
  refuse = (x) => x > 0.5;
  walk(2);
  expect((await scores()).at(-1)?.moments).toBe(2);
  refuse = () => true;
  walk(2);
  await expect(scores()).rejects.toThrow("The server is full.");
  await Promise.resolve();
  expect(open).toBe(0);
});

test("a walk that goes on ends it, and what is too short is forgotten", async () => {
  walk(2);
  const controller = new AbortController();
  for await (const { moments } of quality.scores(controller.signal)) {
    expect(moments).toBe(1);
    controller.abort();
  }
  walk(1);
  quality.forget();
  expect(await scores()).toEqual([]);
  await Promise.resolve();
  expect(open).toBe(0);
});

test("a picture that cannot be had is one of nothing", async () => {
  quality.walked(at(3), () => [Promise.reject(new Error("lost")), null], 0);
  expect((await scores())[0]?.psnr).toEqual([-3, -3]);
});
