/** Baseline: the picture scaled to the displayed size by a bicubic filter. */
import type { Enhancer } from "../model/enhancer";
import { AS_IT_IS } from "./as-it-is";

export const BICUBIC: Enhancer = {
  name: "bicubic",
  label: "Bicubic",
  kind: "upscale",
  scale: 1,
  filter: "bicubic",
  load: async () => AS_IT_IS,
};
