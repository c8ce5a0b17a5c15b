import { signal } from "@preact/signals";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { STILL, steeredRig } from "#fakes/rig";
import { groundTruth } from "../quality/ground-truth";
import { DEFAULT_SETTINGS } from "../state/settings";
import { type Figures, NO_FIGURES } from "../view/meter";
import type { PresentedFrame } from "../view/presented";
import type { Rig } from "../view/rig";
import { Comparison } from "./comparison";

vi.mock("../quality/ground-truth", () => ({ groundTruth: vi.fn(), psnrOf: () => [30, 20] }));

let rig: Rig;
let axes: typeof STILL;
let sides: ReturnType<typeof fakeSide>[];
let comparison: Comparison;

/** A page that is always visible. */
const every = (interval: number, task: () => void) => {
  const timer = setInterval(task, interval);
  return () => clearInterval(timer);
};

function fakeSide() {
  const listeners = new Set<(frame: PresentedFrame) => void>();
  return {
    settings: signal(DEFAULT_SETTINGS),
    figures: { ...NO_FIGURES, contentAge: 50 } as Figures,
    present: (latency: number) => {
      for (const tell of listeners) tell({ latencies: [latency], at: performance.now() } as unknown as PresentedFrame);
    },
    onPresented: (listener: (frame: PresentedFrame) => void) => {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    picture: vi.fn(async () => ({ close: () => undefined }) as ImageBitmap),
  };
}

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["setInterval", "clearInterval", "performance"] });
  vi.mocked(groundTruth).mockReset();
  vi.mocked(groundTruth).mockImplementation(async () => ({ close: () => undefined }) as ImageBitmap);
  axes = STILL;
  rig = steeredRig(() => axes);
  sides = [fakeSide(), fakeSide()];
  comparison = new Comparison(rig, sides, { every }, signal(null));
});

afterEach(() => {
  comparison.dispose();
  vi.useRealTimers();
});

async function frames(seconds: number): Promise<void> {
  for (let i = 0; i < seconds * 20; i++) {
    await vi.advanceTimersByTimeAsync(50);
    if (rig.sample(performance.now())) for (const [n, side] of sides.entries()) side.present(20 + 100 * n);
    sides.forEach((side) => {
      side.figures = { ...side.figures, shown: side.figures.shown + 1, bytes: side.figures.bytes + 1000 };
    });
  }
}

async function walk(seconds: number): Promise<void> {
  axes = { ...STILL, turnRight: 1 };
  await frames(seconds);
  axes = STILL;
}

test("a walk is held against ground truth once it has ended, and nothing is asked for meanwhile", async () => {
  await frames(1);
  await walk(4);
  expect(groundTruth).not.toHaveBeenCalled();
  const kept = sides[0]?.picture.mock.calls.length ?? 0;
  expect(kept).toBeGreaterThan(3);
  await frames(3);
  expect(comparison.walks.last.value?.sides).toMatchObject([{ latency: { p50: 20 } }, { latency: { p50: 120 } }]);
  expect(comparison.quality.value).toMatchObject({ psnr: [30, 20], problem: null });
  expect(sides[0]?.picture).toHaveBeenCalledTimes(kept); // at rest nothing is kept
});

test("a server that gives no ground truth says why, and the rest of the summary is there", async () => {
  vi.mocked(groundTruth).mockRejectedValue(new Error("The server is full."));
  await frames(1);
  await walk(4);
  await frames(3);
  expect(comparison.walks.last.value?.sides[0]).toMatchObject({ latency: { p50: 20 } });
  expect(comparison.quality.value).toEqual({ psnr: [], moments: 0, problem: "The server is full." });
});

test("one stream alone is measured, and not judged", async () => {
  comparison.dispose();
  comparison = new Comparison(rig, sides.slice(0, 1), { every }, signal(null));
  await frames(1);
  await walk(4);
  await frames(3);
  expect(comparison.history.series.bandwidth.value).toHaveLength(2);
  expect(sides[0]?.picture).not.toHaveBeenCalled();
  expect(groundTruth).not.toHaveBeenCalled();
});

test("a comparison that is over looks no more", async () => {
  comparison.dispose();
  const before = comparison.history.series.newViews.value;
  await frames(1);
  expect(comparison.history.series.newViews.value).toBe(before);
});
