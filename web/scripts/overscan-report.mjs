// How much of the view frames leave uncovered without overscan, with a fixed one and with auto, over movements (docs/abr.md).
import { readFileSync } from "node:fs";
import { basename } from "node:path";
import { parseArgs } from "node:util";
import { number } from "./arguments.mjs";
import { load } from "./page-module.mjs";

const USAGE = `npm run overscan-report -- [options] MOVEMENT.csv...
  --age MS            how old frames are when they are seen [140]
  --predictor NAME    may be repeated [off, velocity, linear]
  --overscan SHARE    of the viewport at each side, or auto; may be repeated [0, 0.05, 0.1, 0.15, 0.25, auto]
  --seconds N         of each movement, from its beginning [all]
`;

async function main() {
  const { values, positionals } = parseArgs({
    allowPositionals: true,
    options: {
      age: { type: "string", default: "140" },
      predictor: { type: "string", multiple: true, default: ["off", "velocity", "linear"] },
      overscan: { type: "string", multiple: true, default: ["0", "0.05", "0.1", "0.15", "0.25", "auto"] },
      seconds: { type: "string", default: "Infinity" },
      help: { type: "boolean", default: false },
    },
  });
  if (values.help || positionals.length === 0) return process.stdout.write(USAGE);
  const [{ replay }, { PREDICTOR_NAMES }, { readMovement }] = await Promise.all(
    ["reproject/overscan-replay", "predict/registry", "movement/movement"].map(load),
  );
  const age = number("--age", values.age);
  const until = 1000 * number("--seconds", values.seconds);
  for (const name of values.predictor) {
    if (!PREDICTOR_NAMES.includes(name))
      throw new Error(`There is no predictor “${name}”: ${PREDICTOR_NAMES.join(", ")}.`);
  }
  const movements = positionals.map((path) =>
    readMovement(readFileSync(path, "utf8"), basename(path)).points.filter(({ t_ms }) => t_ms <= until),
  );
  process.stdout.write("| prediction | overscan | uncovered, mean (worst recording) | pixels |\n|---|---|---:|---:|\n");
  for (const predictor of values.predictor) {
    for (const text of values.overscan) {
      const overscan = text === "auto" ? text : number("--overscan", text);
      const found = movements.map((points) => replay(points, { age, predictor, overscan }));
      const mean = (name) => found.reduce((sum, one) => sum + one[name], 0) / found.length;
      const worst = Math.max(...found.map(({ uncovered }) => uncovered));
      const cells = [predictor, text, `${percent(mean("uncovered"))} (${percent(worst)})`, mean("pixels").toFixed(2)];
      process.stdout.write(`| ${cells.join(" | ")} |\n`);
    }
  }
}

function percent(share) {
  return `${(100 * share).toFixed(1)} %`;
}

try {
  await main();
} catch (error) {
  process.stderr.write(`${error.message}\n`);
  process.exitCode = 1;
}
