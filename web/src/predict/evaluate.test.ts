import { expect, test } from "vitest";
import type { TimedPose } from "../movement/playback";
import { orientation } from "../view/camera";
import { recorded, steered } from "./courses";
import { evaluate, predictions } from "./evaluate";
import { tables } from "./report";

/** Turns at 30 degrees a second for two seconds, and walks at 1 m/s. */
const TURN: TimedPose[] = Array.from({ length: 101 }, (_, i) => ({
  t_ms: 20 * i,
  position: [i / 50, 0, 0],
  quaternion: [...orientation(0.6 * i, 0)],
}));

test("counts how far the camera gets where nothing is predicted", () => {
  const [errors] = evaluate(recorded(TURN), "off", [100]);
  for (const degrees of errors?.degrees ?? []) expect(degrees).toBeCloseTo(3, 6);
  for (const metres of errors?.distance ?? []) expect(metres).toBeCloseTo(0.1, 6);
  expect(errors?.degrees).toHaveLength(71); // from 500 ms to 1900 ms
});

test("counts neither rests nor what is across a gap", () => {
  const end = TURN.at(-1) as TimedPose;
  const rest = Array.from({ length: 100 }, (_, i) => ({ ...end, t_ms: 2020 + 20 * i }));
  const [resting] = evaluate(recorded([...TURN, ...rest]), "off", [100]);
  expect(resting?.degrees.length).toBeLessThan(71 + 20);
  const gap = TURN.map((point) => ({ ...point, t_ms: point.t_ms + (point.t_ms > 1000 ? 500 : 0) }));
  const [apart] = evaluate(recorded(gap), "off", [100]);
  expect(Math.max(...(apart?.degrees ?? []))).toBeCloseTo(3, 6);
});

test("a prediction is told by the time that it is for", () => {
  const { said } = predictions(recorded(TURN, 60), "velocity", [100]);
  const one = said[0]?.find(({ t_ms }) => t_ms >= 1000);
  expect(one?.position[0]).toBeCloseTo((one?.t_ms ?? 0) / 1000, 3);
});

test("someone who steers is foreseen better by the input than by what was seen", () => {
  const mean = (name: "off" | "velocity" | "input") => {
    const [errors] = evaluate(steered(60, 1), name, [100]);
    return (errors?.degrees ?? []).reduce((sum, value) => sum + value, 0) / (errors?.degrees.length ?? 0);
  };
  expect(mean("input")).toBeLessThan(mean("velocity"));
  expect(mean("velocity")).toBeLessThan(mean("off") / 2);
});

test("tables have mean, median and 95th percentile of every horizon, each movement counting the same", () => {
  const of = (degrees: number[]) => ({ degrees, distance: degrees.map((value) => value / 100) });
  const text = tables([{ predictor: "off", errors: [[of([1, 2, 9]), of([4, 4, 4])]] }], [100]);
  const rows = text.split("\n").filter((line) => line.includes("off"));
  expect(rows.map((row) => row.replaceAll(" ", ""))).toEqual(["|off|4.00/3.00/6.50|", "|off|4.0/3.0/6.5|"]);
});
