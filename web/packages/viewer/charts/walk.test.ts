import { expect, test } from "vitest";
import { NO_FIGURES as NOTHING } from "../view/meter";
import { WalkRecorder } from "./walk";

const NO_FIGURES = { ...NOTHING, contentAge: 50 };

/** Walks from `from` to `to` and is observed for two more seconds; the left side shows 40 new views per second, and the right one 20. */
function walk(recorder: WalkRecorder, from: number, to: number): void {
  for (let now = from; now <= to + 2250; now += 250) {
    const moved = Math.min(now, to);
    recorder.sampled(moved, moved);
    recorder.presented(0, { latencies: [20, 40] });
    recorder.presented(1, { latencies: [700] });
    const figures = { ...NO_FIGURES, newViews: moved * 0.04, bytes: now * 1000 };
    // Frames sent later, while the camera stands still, are not part of the walk.
    const newViews = Math.max(from, now - 1000) * 0.02;
    const dash = { ...figures, contentAge: 800, newViews, bytes: now * 250, stalls: { count: 1, time: moved / 10 } };
    recorder.sample([figures, dash], now);
  }
}

function recorder(): WalkRecorder {
  const one = new WalkRecorder();
  one.sampled(0, 0);
  return one;
}

test("a walk is what happened while the camera moved, and stays", () => {
  const one = recorder();
  walk(one, 1000, 11_000);
  const seen = one.last.value;
  expect(seen).toEqual({
    duration: 10_000,
    sides: [
      {
        inputs: 96,
        contentAge: 50,
        latency: { p50: 20, p95: 40 },
        newViewsPerSecond: 40,
        bandwidth: 8_000_000,
        bytes: 10_000_000,
        stalled: 0,
      },
      {
        inputs: 48,
        contentAge: 800,
        latency: { p50: 700, p95: 700 },
        newViewsPerSecond: 22,
        bandwidth: 2_000_000,
        bytes: 2_500_000,
        stalled: 1000,
      },
    ],
  });
  walk(one, 20_000, 21_000); // too short to count
  expect(one.last.value).toBe(seen);
  walk(one, 30_000, 34_000);
  expect(one.last.value?.duration).toBe(4000);
});

test("while the camera moves there is none, nor where nobody walked", () => {
  const one = recorder();
  for (let now = 250; now <= 20_000; now += 250) one.sample([NO_FIGURES, null], now);
  expect(one.last.value).toBeNull();
  for (let now = 20_250; now <= 40_000; now += 250) {
    one.sampled(now, now);
    one.sample([NO_FIGURES, null], now);
  }
  expect(one.last.value).toBeNull();
});

test("a side that showed nothing has no figures", () => {
  const one = recorder();
  for (let now = 250; now <= 8000; now += 250) {
    one.sampled(Math.min(now, 5000), Math.min(now, 5000));
    one.presented(0, { latencies: [20] });
    one.sample([NO_FIGURES, null], now);
  }
  expect(one.last.value?.sides).toMatchObject([{ latency: { p50: 20 } }, "nothing"]);
});

test("a walk counts from the first picture of a side that comes while it goes on", () => {
  const one = recorder();
  for (let now = 250; now <= 12_000; now += 250) {
    const moved = Math.min(now, 9000);
    one.sampled(moved, moved);
    one.presented(0, { latencies: [20] });
    const stateless = { ...NO_FIGURES, shown: moved, newViews: moved };
    // Not open at first, then open, and playing from the third second on.
    const stream = now < 1000 ? null : { ...NO_FIGURES, shown: Math.max(0, moved - 3000) };
    if (stream?.shown) one.presented(1, { latencies: [150] });
    one.sample([stateless, stream && { ...stream, newViews: stream.shown }], now);
  }
  expect(one.last.value).toMatchObject({
    duration: 5500,
    sides: [
      { latency: { p50: 20 }, newViewsPerSecond: 1000 },
      { latency: { p50: 150 }, newViewsPerSecond: 1000 },
    ],
  });
});

test.each([
  ["at once", (now: number) => (now < 3000 ? 9_000_000 + now : now - 3000)],
  ["after a while in which there is none", (now: number) => (now < 3000 ? 500 : now < 4000 ? null : now - 4000)],
])("a side that begins anew %s has no figures, however much it has shown since", (_, shownAt) => {
  const one = recorder();
  for (let now = 1000; now <= 8000; now += 250) {
    const moved = Math.min(now, 5000);
    one.sampled(moved, moved);
    one.presented(0, { latencies: [20] });
    const shown = shownAt(now);
    one.sample([shown === null ? null : { ...NO_FIGURES, shown }], now);
  }
  expect(one.last.value?.sides).toEqual(["restarted"]);
});
