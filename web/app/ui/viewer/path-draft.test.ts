import { expect, test } from "vitest";
import { cameraPath } from "#viewer/movement/camera-path";
import {
  draftOf,
  durationOf,
  emptyPath,
  type PathDraft,
  stopsOf,
  withDuration,
  withLoop,
  withoutStop,
  withStop,
} from "./path-draft";

const at = (x: number) => ({ position: [x, 0, 0], quaternion: [0, 0, 0, 1] }) as never;
const path = (...xs: number[]) => xs.reduce((draft, x) => withStop(draft, at(x)), emptyPath("Tour"));
const times = ({ keyframes }: PathDraft) => keyframes.map(({ t_ms }) => t_ms);
const places = ({ keyframes }: PathDraft) => keyframes.map(({ position }) => position[0]);

test("keyframes are added at the end, as far apart as the others", () => {
  expect(times(path(1, 2, 3))).toEqual([0, 3000, 6000]);
  expect(times(withStop(withDuration(path(1, 2, 3), 1000), at(4)))).toEqual([0, 500, 1000, 1500]);
});

test("a loop ends where it begins, whatever is added and removed", () => {
  const loop = withLoop(path(1, 2), true);
  expect([places(loop), times(loop)]).toEqual([
    [1, 2, 1],
    [0, 3000, 6000],
  ]);
  const longer = withStop(loop, at(3));
  expect([places(longer), times(longer)]).toEqual([
    [1, 2, 3, 1],
    [0, 3000, 6000, 9000],
  ]);
  expect(places(withoutStop(longer, 0))).toEqual([2, 3, 2]);
  expect([places(withLoop(longer, false)), stopsOf(longer).length]).toEqual([[1, 2, 3], 3]);
});

test("without its first keyframe a path begins at once", () => {
  const uneven = draftOf("Tour", {
    keyframes: [0, 1000, 5000].map((t_ms, x) => ({ t_ms, ...(at(x) as object) })) as never,
  });
  expect(times(withoutStop(uneven, 0))).toEqual([0, 4000]);
  expect(times(withoutStop(uneven, 1))).toEqual([0, 5000]);
  expect(places(withoutStop(path(1), 0))).toEqual([]);
});

test("another duration keeps the shares of time", () => {
  const uneven = withDuration(withoutStop(path(1, 2, 3, 4), 1), 4500);
  expect([times(uneven), durationOf(uneven)]).toEqual([[0, 3000, 4500], 4500]);
});

test("what can be saved can be played", () => {
  expect(cameraPath(withLoop(path(1, 2), true).keyframes, { closed: true }).duration).toBe(6000);
});
