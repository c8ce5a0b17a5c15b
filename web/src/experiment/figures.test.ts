import { expect, test } from "vitest";
import golden from "../../../tests/experiments/records/figures.golden.json";
import type { Input } from "../wire/store";
import { figures, inputLatencies, percentile } from "./figures";

interface Case {
  readonly duration_ms: number;
  readonly inputs: readonly [at: number, pose: number][];
  readonly frames: readonly [at: number, pose: number, rung: number | null, height: number, view?: number][];
  readonly traffic: readonly [at: number, bytes: number][];
  readonly figures: Readonly<Record<string, number | null>>;
}

const input = (at: number, pose: number): Input => ({ at, pose, position: [0, 0, 0], quaternion: [0, 0, 0, 1] });
const frame = (at: number, pose: number, rung: number | null = 0, height = 360, view: number | null = null) => ({
  side: "stateless" as const,
  at,
  pose,
  view,
  latencies: [],
  rung,
  width: 640,
  height,
});

test("an input is answered by the first frame of its pose or of a later one", () => {
  const inputs = [input(0, 1), input(10, 2), input(20, 3), input(30, 9)];
  const frames = [frame(5, 0), frame(40, 2), frame(60, 1), frame(90, 4)];
  expect(inputLatencies({ inputs, frames }).map(({ latency }) => latency)).toEqual([
    40,
    30,
    70,
    Number.POSITIVE_INFINITY,
  ]);
});

test.each(Object.entries(golden as unknown as Readonly<Record<string, Case>>))(
  "%s",
  (_, { figures: worked, ...records }) => {
    const { received_kbps, content_age_mean, ...expected } = worked;
    const found = figures({
      duration_ms: records.duration_ms,
      inputs: records.inputs.map((of) => input(...of)),
      frames: records.frames.map((of) => frame(...of)),
      traffic: records.traffic.map(([at, bytes]) => ({ at, bytes })),
    });
    expect(found).toEqual({
      p50: expected.p50,
      p90: expected.p90,
      p95: expected.p95,
      p99: expected.p99,
      viewP50: expected.view_p50,
      viewP95: expected.view_p95,
      interactive: expected.share_interactive,
      interactiveFrameLess: expected.share_frame_less,
      interactiveFrameMore: expected.share_frame_more,
      contentAge: content_age_mean == null ? null : expect.closeTo(content_age_mean, 5),
      newViewsPerSecond: expected.new_views_per_s,
      meanHeight: expected.mean_height,
      switches: expected.switches,
      received: received_kbps && received_kbps * 1000,
    });
  },
);

test("percentiles are those of the nearest rank", () => {
  expect(percentile([4, 1, 3, 2], 0.5)).toBe(2);
  expect(percentile([4, 1, 3, 2], 0.95)).toBe(4);
  expect(percentile([], 0.5)).toBeNull();
});
