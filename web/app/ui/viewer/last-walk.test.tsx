// @vitest-environment happy-dom
import { cleanup, render, screen } from "@testing-library/preact";
import { afterEach, expect, test } from "vitest";
import { WALKED_SIDE } from "#fakes/session";
import type { Unmeasured, Walk, WalkedSide } from "#viewer/charts/walk";
import { LastWalk, verdict } from "./last-walk";

afterEach(cleanup);

const UNSCORED = { psnr: [], moments: 0, problem: null };
const LOCAL = [false, false];
const NAMES = ["Stateless", "DASH, tuned"];
type Changes = Partial<WalkedSide> | Unmeasured;
const walk = ({ left = {}, right = {} }: { left?: Changes; right?: Changes }): Walk => ({
  duration: 12_300,
  sides: [left, right].map((changes) => (typeof changes === "string" ? changes : { ...WALKED_SIDE, ...changes })),
});

test.each<[{ left?: Changes; right?: Changes }, string]>([
  [
    { right: { contentAge: 750, newViewsPerSecond: 24.8, bandwidth: 3_000_000 } },
    "Stateless was 690 ms more up to date than DASH, tuned: 48 versus 25 new views per second, for 10 Mbit/s versus 3 Mbit/s.",
  ],
  [
    { left: { contentAge: 102, newViewsPerSecond: 5 } },
    "DASH, tuned was 42 ms more up to date than Stateless: 48 versus 5.0 new views per second, for 10 Mbit/s versus 10 Mbit/s.",
  ],
  [
    { right: { contentAge: 62, bandwidth: 3_000_000 } },
    "Stateless and DASH, tuned were equally up to date: 48 versus 48 new views per second, for 10 Mbit/s versus 3 Mbit/s.",
  ],
  [
    { right: { inputs: 12, contentAge: 30, newViewsPerSecond: 0.3, bandwidth: 500_000 } },
    "Stateless kept up with you, and DASH, tuned hardly did: 48 versus 0.3 new views per second, for 10 Mbit/s versus 500 kbit/s.",
  ],
  [
    { right: { newViewsPerSecond: 0.3, bandwidth: 500_000 } }, // turned at once, but from old pictures
    "Stateless kept up with you, and DASH, tuned hardly did: 48 versus 0.3 new views per second, for 10 Mbit/s versus 500 kbit/s.",
  ],
  [
    { left: { newViewsPerSecond: 1.1, bandwidth: 176_000 }, right: { newViewsPerSecond: 0, bandwidth: 1000 } },
    "DASH, tuned showed nothing new during this walk; Stateless showed 1.1 new views per second.",
  ],
  [{ left: "nothing" }, "Stateless showed nothing new during this walk; DASH, tuned showed 48 new views per second."],
  [{ left: "nothing", right: "nothing" }, "Neither side showed anything new during this walk."],
  [{ left: { newViewsPerSecond: 0 }, right: "nothing" }, "Neither side showed anything new during this walk."],
  [{ right: "restarted" }, "DASH, tuned restarted during this walk; walk again to compare."],
  [
    { left: "restarted", right: "restarted" },
    "Stateless and DASH, tuned restarted during this walk; walk again to compare.",
  ],
])("the verdict is one sentence: %j", (changes, sentence) => {
  expect(verdict(walk(changes), NAMES, UNSCORED)).toBe(sentence);
});

test.each([
  [[31.24, 28.1], "new views per second, with Stateless 3.1 dB closer to the reference, for"],
  [[28.1, 31.24], "new views per second, with DASH, tuned 3.1 dB closer to the reference, for"],
  [[28.1, 28.3], "new views per second, equally close to the reference, for"],
])("once pictures are compared with ground truth, the verdict says which were closer: %j", (psnr, said) => {
  expect(verdict(walk({ right: { contentAge: 750 } }), NAMES, { psnr })).toContain(said);
});

test("each side has its figures", () => {
  const right = { contentAge: 750, latency: { p50: 738, p95: 900 }, stalled: 1440 };
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
    ["Content age", "60 ms", "750 ms"],
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
  [[false, false], "The server draws both sides"],
  [[false, true], "This browser draws DASH, tuned; the server"],
  [[true, true], "This browser draws both sides"],
])("the summary names the renderer: %j", (local, said) => {
  render(<LastWalk names={NAMES} walk={null} quality={UNSCORED} local={local} />);
  expect(screen.getByText(new RegExp(said))).toBeTruthy();
});

test("before the first walk it is said how there comes to be one", () => {
  render(<LastWalk names={NAMES} walk={null} quality={UNSCORED} local={LOCAL} />);
  expect(screen.getByText(/Walk for a few seconds/)).toBeTruthy();
  expect(screen.queryByRole("table")).toBeNull();
});
