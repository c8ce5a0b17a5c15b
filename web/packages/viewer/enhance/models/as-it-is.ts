/** A model that changes nothing and only selects the filter of the last step. */
import type { Loaded } from "../model/enhancer";

export const AS_IT_IS: Loaded = {
  run: (_, input) => input,
  dispose: () => undefined,
};
