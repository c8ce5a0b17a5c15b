/**
 * The models of the enhancement stage.
 *
 * To add one: write a file beside those in `models/` that exports an `Enhancer` (`model/enhancer.ts` says what it must do), and
 * enter it here. The panel, the URL (`?restore=NAME&upscale=NAME`) and the experiment's dialogue offer it then; for experiments'
 * files its name goes into `tigas_common/wire/enhancement.py`, too, and a test compares the two lists.
 */
import type { Enhancer, Kind } from "./model/enhancer";
import { BICUBIC } from "./models/bicubic";
import { LANCZOS } from "./models/lanczos";

/** In the order in which they are offered. */
export const ENHANCERS: readonly Enhancer[] = [BICUBIC, LANCZOS];

/** Where no model is chosen. */
export const OFF = "off";

export function enhancersOf(kind: Kind): readonly Enhancer[] {
  return ENHANCERS.filter((enhancer) => enhancer.kind === kind);
}

/** Null for `off` and for what there is not. */
export function findEnhancer(kind: Kind, name: string): Enhancer | null {
  return enhancersOf(kind).find((enhancer) => enhancer.name === name) ?? null;
}
