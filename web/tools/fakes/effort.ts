/** Number of inputs that a fuzzer tries: the same few in every `make test`, many random ones with `make fuzz`. */
const examples: string | undefined = import.meta.env.VITE_FUZZ_EXAMPLES;

export const EFFORT: { numRuns: number; seed?: number } = examples
  ? { numRuns: Number(examples) }
  : { numRuns: 100, seed: 1 };
