/** The paper's ladder, which is the server's default. */
import type { Rung } from "../wire/render";

export const PAPER_LADDER: readonly Rung[] = [
  { name: "High", width: 1280, height: 720, quality: 90, expected_kb: 240 },
  { name: "Medium-High", width: 960, height: 540, quality: 65, expected_kb: 55 },
  { name: "Medium-Low", width: 640, height: 360, quality: 35, expected_kb: 20 },
  { name: "Low", width: 320, height: 180, quality: 10, expected_kb: 7 },
];
