/**
 * The models of the enhancement stage.
 *
 * To add a model, write a file in `models/` that exports an `Enhancer` (see `model/enhancer.ts`), and list it here. The
 * panel and the experiment dialog then offer it, and URLs (`?restore=NAME&upscale=NAME`) and experiment files may name
 * it.
 */
import { type Enhancer, KINDS, type Kind, OFF } from "./model/enhancer";
import { ANIME4K } from "./models/anime4k";
import { BICUBIC, LANCZOS } from "./models/filters";
import { SCENE } from "./models/scene";

/** All models, in the order in which they are offered. */
export const ENHANCERS: readonly Enhancer[] = [BICUBIC, LANCZOS, ...ANIME4K, SCENE];

export function enhancersOf(kind: Kind): readonly Enhancer[] {
  return ENHANCERS.filter((enhancer) => enhancer.kind === kind);
}

/** The chosen models in the order in which frames pass them; none for `off`. */
export function chosenEnhancers(names: Readonly<Record<Kind, string>>): readonly Enhancer[] {
  return KINDS.flatMap((kind) => enhancersOf(kind).filter(({ name }) => names[kind] === name));
}

/** Why a name cannot be chosen, in one sentence; null if it can. */
export function nameProblem(kind: Kind, name: string): string | null {
  const names = [OFF, ...enhancersOf(kind).map((enhancer) => enhancer.name)];
  return names.includes(name) ? null : `Unknown ${kind} model “${name}”: use ${names.join(", ")}.`;
}
