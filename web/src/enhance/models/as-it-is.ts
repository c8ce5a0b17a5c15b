/** A model that changes nothing: all that its kind does is to choose the filter of the last step. */
import type { Loaded } from "../model/enhancer";

export const AS_IT_IS: Loaded = {
  run: (_, input) => input,
  dispose: () => undefined,
};
