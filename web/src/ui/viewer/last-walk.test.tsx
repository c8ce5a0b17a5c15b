// @vitest-environment happy-dom
import { cleanup, render, screen } from "@testing-library/preact";
import { afterEach, expect, test } from "vitest";
import type { Unmeasured, Walk, WalkedSide } from "../../charts/walk";
import { LastWalk, verdict } from "./last-walk";

afterEach(cleanup);

const SIDE: WalkedSide = {
  inputs: 600,
  latency: { p50: 48, p95: 96 },
  newViewsPerSecond: 47.6,
  bandwidth: 10_200_000,
  bytes: 15_700_000,
  stalled: 0,
};
const UNSCORED = { psnr: [], moments: 0, problem: null };
const LOCAL = [false, false];
const NAMES = ["Stateless", "DASH, tuned"];
type Changes = Partial<WalkedSide> | Unmeasured;
const walk = ({ left = {}, right = {} }: { left?: Changes; right?: Changes }): Walk => ({
  duration: 12_300,
  sides: [left, right].map((changes) => (typeof changes === "string" ? changes : { ...SIDE, ...changes })),
});

test.each<[{ left?: Changes; right?: Changes }, string]>([
  [
    { right: { latency: { p50: 738, p95: 900 }, newViewsPerSecond: 24.8, bandwidth: 3_000_000 } },
    "Stateless followed you 690 ms sooner than DASH, tuned: 48 against 25 new views a second, for 10 Mbit/s against 3 Mbit/s.",
  ],
  [
    { left: { latency: { p50: 90, p95: 900 }, newViewsPerSecond: 5 } },
    "DASH, tuned followed you 42 ms sooner than Stateless: 48 against 5.0 new views a second, for 10 Mbit/s against 10 Mbit/s.",
  ],
  [
    { right: { latency: { p50: 50, p95: 99 }, bandwidth: 3_000_000 } },
    "Stateless and DASH, tuned followed you equally soon: 48 against 48 new views a second, for 10 Mbit/s against 3 Mbit/s.",
  ],
  [
    { right: { inputs: 12, latency: { p50: 30, p95: 40 }, newViewsPerSecond: 0.3, bandwidth: 500_000 } },
    "Stateless followed you, and DASH, tuned hardly did: 48 against 0.3 new views a second, for 10 Mbit/s against 500 kbit/s.",
  ],
  [{ right: "nothing" }, "Only Stateless showed anything of this walk."],
  [{ left: "nothing", right: "nothing" }, "Neither side showed anything of this walk."],
  [{ right: "restarted" }, "DASH, tuned restarted during this walk; walk again to compare."],
  [
    { left: "restarted", right: "restarted" },
    "Stateless and DASH, tuned restarted during this walk; walk again to compare.",
  ],
])("the verdict is one sentence: %j", (changes, sentence) => {
  expect(verdict(walk(changes), NAMES, UNSCORED)).toBe(sentence);
});

test.each([
  [[31.24, 28.1], "new views a second, with Stateless 3.1 dB nearer to the truth, for"],
  [[28.1, 31.24], "new views a second, with DASH, tuned 3.1 dB nearer to the truth, for"],
  [[28.1, 28.3], "new views a second, as near to the truth, for"],
])("of pictures that were held against the truth, the verdict says which were nearer: %j", (psnr, said) => {
  expect(verdict(walk({ right: { latency: { p50: 738, p95: 900 } } }), NAMES, { psnr })).toContain(said);
});

test("each side has its figures", () => {
  const right = { latency: { p50: 738, p95: 900 }, stalled: 1440 };
  render(
    <LastWalk
      names={NAMES}
      walk={walk({ right })}
      quality={{ psnr: [30.26, 22.1], moments: 6, problem: null }}
      local={LOCAL}
    />,
  );
  const rows = screen.getAllByRole("row").map((row) => [...row.children].map((cell) => cell.textContent));
  expect(rows).toEqual([
    ["12 s", "Stateless", "DASH, tuned"],
    ["Latency, p50 · p95", "48 · 96 ms", "738 · 900 ms"],
    ["New views/s", "48", "48"],
    ["Stalled", "0.0 s", "1.4 s"],
    ["Bit rate", "10 Mbit/s", "10 Mbit/s"],
    ["Received", "16 MB", "16 MB"],
    ["PSNR as seen", "30.3 dB", "22.1 dB"],
  ]);
});

test.each([
  [{ ...UNSCORED }, "…"],
  [{ ...UNSCORED, problem: "The server is full." }, "–"],
])("without ground truth there is no figure, and the reason where there is one: %j", (quality, cell) => {
  render(<LastWalk names={NAMES} walk={walk({})} quality={quality} local={LOCAL} />);
  const row = screen.getByRole("row", { name: /PSNR/ });
  expect([...row.children].slice(1).map(({ textContent }) => textContent)).toEqual([cell, cell]);
  if (quality.problem) expect(row.title).toBe(quality.problem);
});

test.each([
  [[false, false], "One renderer draws both sides"],
  [[false, true], "This browser draws DASH, tuned; the server"],
  [[true, true], "This browser draws both sides"],
])("it is said who draws: %j", (local, said) => {
  render(<LastWalk names={NAMES} walk={null} quality={UNSCORED} local={local} />);
  expect(screen.getByText(new RegExp(said))).toBeTruthy();
});

test("before the first walk it is said how there comes to be one", () => {
  render(<LastWalk names={NAMES} walk={null} quality={UNSCORED} local={LOCAL} />);
  expect(screen.getByText(/Walk for a few seconds/)).toBeTruthy();
  expect(screen.queryByRole("table")).toBeNull();
});
