// @vitest-environment happy-dom
import { cleanup, render, screen } from "@testing-library/preact";
import { afterEach, expect, test } from "vitest";
import type { Walk, WalkedSide } from "../../charts/walk";
import { LastWalk, verdict } from "./last-walk";

afterEach(cleanup);

const SIDE: WalkedSide = {
  latency: { p50: 48, p95: 96 },
  newViewsPerSecond: 47.6,
  bandwidth: 10_200_000,
  stalled: 0,
};
const walk = (changes: { stateless?: Partial<WalkedSide> | null; dash?: Partial<WalkedSide> | null }): Walk => {
  const { stateless = {}, dash = {} } = changes;
  return {
    duration: 12_300,
    sides: { stateless: stateless && { ...SIDE, ...stateless }, dash: dash && { ...SIDE, ...dash } },
  };
};

test.each([
  [
    { dash: { latency: { p50: 738, p95: 900 }, newViewsPerSecond: 24.8, bandwidth: 3_000_000 } },
    "Stateless followed you 690 ms sooner than DASH: 48 against 25 new views a second, for 10 Mbit/s against 3 Mbit/s.",
  ],
  [
    { stateless: { latency: { p50: 90, p95: 900 }, newViewsPerSecond: 5 } },
    "DASH followed you 42 ms sooner than Stateless: 48 against 5.0 new views a second, for 10 Mbit/s against 10 Mbit/s.",
  ],
  [
    { dash: { latency: { p50: 50, p95: 99 }, bandwidth: 3_000_000 } },
    "Stateless and DASH followed you equally soon: 48 against 48 new views a second, for 10 Mbit/s against 3 Mbit/s.",
  ],
  [{ dash: null }, "Only Stateless showed anything of this walk."],
  [{ stateless: null, dash: null }, "Neither side showed anything of this walk."],
])("the verdict is one sentence: %j", (changes, sentence) => {
  expect(verdict(walk(changes))).toBe(sentence);
});

test("each side has its figures", () => {
  render(<LastWalk walk={walk({ dash: { latency: { p50: 738, p95: 900 }, stalled: 1440 } })} />);
  const rows = screen.getAllByRole("row").map((row) => [...row.children].map((cell) => cell.textContent));
  expect(rows.slice(1)).toEqual([
    ["Stateless", "48 · 96 ms", "48", "10 Mbit/s", "0.0 s"],
    ["DASH", "738 · 900 ms", "48", "10 Mbit/s", "1.4 s"],
  ]);
});

test("before the first walk it is said how there comes to be one", () => {
  render(<LastWalk walk={null} />);
  expect(screen.getByText(/Walk for a few seconds/)).toBeTruthy();
  expect(screen.queryByRole("table")).toBeNull();
});
