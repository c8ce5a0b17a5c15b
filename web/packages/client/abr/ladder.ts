/** The paper's ladder, which is the server's default. */
import type { Rung } from "../wire/render";

export const PAPER_LADDER: readonly Rung[] = [
  { name: "High", width: 1280, height: 720, quality: 90, expected_kb: 240 },
  { name: "Medium-High", width: 960, height: 540, quality: 65, expected_kb: 55 },
  { name: "Medium-Low", width: 640, height: 360, quality: 35, expected_kb: 20 },
  { name: "Low", width: 320, height: 180, quality: 10, expected_kb: 7 },
];

/** QUIC's initial window (RFC 9002, section 7.2) in kB, less a fifth for margins, depth and headers. */
const FIRST_WINDOW = 0.8 * 14.72;

/** The best rung with frames that fit into a single round trip on any link. */
export function firstRung(ladder: readonly Rung[]): number {
  const first = ladder.findIndex(({ expected_kb }) => expected_kb <= FIRST_WINDOW);
  return first < 0 ? ladder.length - 1 : first;
}
