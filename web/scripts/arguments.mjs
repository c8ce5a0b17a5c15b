// Command lines of the simulator's scripts.

/** Options of the simulated server and page, for `parseArgs`. */
export const SERVER = {
  render: { type: "string" },
  "render-best": { type: "string" },
  scale: { type: "string" },
  batch: { type: "string" },
};

/** The given ones of these options, as numbers. */
export function serverOptions(values) {
  const names = { render: "render", renderBest: "render-best", scale: "scale", batch: "batch" };
  const given = Object.entries(names).filter(([, option]) => values[option] !== undefined);
  return Object.fromEntries(given.map(([name, option]) => [name, number(`--${option}`, values[option])]));
}

/** Runs a script, which may end with an Error of one sentence. */
export async function runScript(main) {
  try {
    await main();
  } catch (error) {
    process.stderr.write(`${error.message}\n`);
    process.exitCode = 1;
  }
}

/** At least 0. Throws an Error of one sentence, which a person reads. */
export function number(option, text) {
  const value = Number(text);
  if (text.trim() === "" || !Number.isFinite(value) || value < 0) {
    throw new Error(`${option} needs a number of at least 0, not “${text}”.`);
  }
  return value;
}
