// Regenerates the TypeScript of the Python wire types; with --check it only says whether it is up to date.
import { execFileSync } from "node:child_process";
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { compile } from "json-schema-to-typescript";

/** The generated files, `src/wire/NAME.ts`: the Python module that prints each one's schema, and its source. */
const GENERATED = {
  render: { schema: ["tigas_common.wire.schema", "render"], source: "services/common/tigas_common/wire/render.py" },
  dash: { schema: ["tigas_common.wire.schema", "dash"], source: "services/common/tigas_common/wire/dash.py" },
  shaper: { schema: ["tigas_common.wire.schema", "shaper"], source: "services/common/tigas_common/wire/shaper.py" },
  store: { schema: ["tigas_experiments.store.schema"], source: "services/experiments/tigas_experiments/store/wire.py" },
};

const venv = fileURLToPath(new URL("../../.venv/bin/python", import.meta.url));
const python = process.env.PYTHON ?? (existsSync(venv) ? venv : "python3");

for (const [name, { schema, source }] of Object.entries(GENERATED)) {
  const file = `src/wire/${name}.ts`;
  const target = fileURLToPath(new URL(`../${file}`, import.meta.url));
  const generated = await compile(readSchema(schema), name, {
    additionalProperties: false,
    bannerComment: `// Generated from ${source} by \`npm run wire\`. Do not edit.`,
  });
  if (!process.argv.includes("--check")) {
    writeFileSync(target, generated);
  } else if (!existsSync(target) || readFileSync(target, "utf8") !== generated) {
    process.stderr.write(`web/${file} does not match ${source}: run \`npm run wire\` and commit the result.\n`);
    process.exitCode = 1;
  }
}

// Pydantic writes draft 2020-12, the generator reads draft 4: a tuple's members are called `items` there.
function readSchema(module) {
  return JSON.parse(execFileSync(python, ["-m", ...module], { encoding: "utf8" }), (_, value) =>
    value?.prefixItems ? { ...value, items: value.prefixItems, prefixItems: undefined } : value,
  );
}
