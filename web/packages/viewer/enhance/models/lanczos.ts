/** Baseline: the picture scaled to the displayed size by a Lanczos filter. */
import type { Enhancer } from "../model/enhancer";
import { AS_IT_IS } from "./as-it-is";

export const LANCZOS: Enhancer = {
  name: "lanczos",
  label: "Lanczos",
  kind: "upscale",
  scale: 1,
  filter: "lanczos",
  load: async () => AS_IT_IS,
};
