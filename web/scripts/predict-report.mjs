// How far off the page's predictors of poses are, over movements (docs/prediction.md); --write saves what they predict.
import { readFileSync, writeFileSync } from "node:fs";
import { basename } from "node:path";
import { parseArgs } from "node:util";
import { positive } from "./arguments.mjs";
import { load } from "./page-module.mjs";

const USAGE = `npm run predict-report -- [options] MOVEMENT.csv...
  --predictor NAME    may be repeated [all]
  --horizon MS        may be repeated [50, 100, 200, 300]
  --rate HZ           samples a second of the movements [as recorded, so that nothing of the future is between two]
  --steered SECONDS   also someone made up who steers by keys and pointer
  --each              a table for each movement
  --write FILE        a CSV of what is foretold: movement, predictor, t_ms (for when), horizon_ms and the pose, in the
                      movement's own frame; one predictor at --rate 1000 is what \`benchmarks.reprojection\` takes
`;

async function main() {
  const { values, positionals } = parseArgs({
    allowPositionals: true,
    options: {
      predictor: { type: "string", multiple: true },
      horizon: { type: "string", multiple: true, default: ["50", "100", "200", "300"] },
      rate: { type: "string" },
      steered: { type: "string" },
      each: { type: "boolean", default: false },
      write: { type: "string" },
      help: { type: "boolean", default: false },
    },
  });
  if (values.help || (positionals.length === 0 && values.steered === undefined)) return process.stdout.write(USAGE);
  const [{ evaluate, predictions }, { recorded, steered }, { PREDICTOR_NAMES }, { tables }, { readMovement }] =
    await Promise.all(
      ["predict/evaluate", "predict/courses", "predict/registry", "predict/report", "movement/movement"].map(load),
    );
  const horizons = values.horizon.map((text) => positive("--horizon", text));
  const rate = values.rate === undefined ? null : positive("--rate", values.rate);
  const predictors = values.predictor ?? PREDICTOR_NAMES;
  for (const name of predictors) {
    if (!PREDICTOR_NAMES.includes(name))
      throw new Error(`There is no predictor “${name}”: ${PREDICTOR_NAMES.join(", ")}.`);
  }
  const movements = positionals.map((path) => {
    const name = basename(path, ".csv");
    const trace = readMovement(readFileSync(path, "utf8"), basename(path));
    return { name, trace, course: () => recorded(trace.points, rate) };
  });
  const report = (title, courses) => {
    const rows = predictors.map((predictor) => {
      const each = courses.map((course) => evaluate(course(), predictor, horizons));
      return { predictor, errors: horizons.map((_, i) => each.map((one) => one[i])) };
    });
    process.stdout.write(`${title}\n\n${tables(rows, horizons)}\n\n`);
  };
  if (movements.length > 0)
    report(
      `${movements.length} movements`,
      movements.map(({ course }) => course),
    );
  if (values.each) for (const { name, course } of movements) report(name, [course]);
  if (values.steered !== undefined) {
    const seconds = positive("--steered", values.steered);
    report(`Keys and pointer, ${seconds} s`, [() => steered(seconds, 1)]);
  }
  if (values.write === undefined) return;
  const lines = movements.flatMap(({ name, course }) =>
    predictors.flatMap((predictor) => {
      const { said } = predictions(course(), predictor, horizons);
      return horizons.flatMap((horizon, i) =>
        said[i].map(({ t_ms, position, quaternion }) => {
          const numbers = [t_ms, horizon, ...position, ...quaternion].map((value) => Number(value.toFixed(6)));
          return [name, predictor, ...numbers].join();
        }),
      );
    }),
  );
  const header = "movement,predictor,t_ms,horizon_ms,x,y,z,qx,qy,qz,qw";
  writeFileSync(values.write, `${[header, ...lines].join("\n")}\n`);
}

try {
  await main();
} catch (error) {
  process.stderr.write(`${error.message}\n`);
  process.exitCode = 1;
}
