/** Baselines: the unchanged picture, scaled to the displayed size by the filter of the last step. */
import type { Enhancer, Filter, Loaded } from "../model/enhancer";

const AS_IT_IS: Loaded = {
  run: (_, input) => input,
  dispose: () => undefined,
};

const model = (filter: Filter, label: string): Enhancer => ({
  name: filter,
  label,
  kind: "upscale",
  filter,
  load: async () => AS_IT_IS,
});

export const BICUBIC = model("bicubic", "Bicubic");
export const LANCZOS = model("lanczos", "Lanczos");
