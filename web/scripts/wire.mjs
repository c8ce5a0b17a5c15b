// Regenerates the TypeScript of the Python wire types; with --check it only says whether it is up to date.
import { execFileSync } from "node:child_process";
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { compile } from "json-schema-to-typescript";

/** `src/wire/NAME.ts` is generated from `wire/NAME.py`, whose schema `tigas_common.wire.schema` prints. */
const NAMES = ["render", "dash", "shaper", "store"];

const venv = fileURLToPath(new URL("../../.venv/bin/python", import.meta.url));
const python = process.env.PYTHON ?? (existsSync(venv) ? venv : "python3");

for (const name of NAMES) {
  const source = `services/common/tigas_common/wire/${name}.py`;
  const file = `src/wire/${name}.ts`;
  const target = fileURLToPath(new URL(`../${file}`, import.meta.url));
  const generated = await compile(readSchema(name), name, {
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
function readSchema(name) {
  const json = execFileSync(python, ["-m", "tigas_common.wire.schema", name], { encoding: "utf8" });
  return JSON.parse(json, (_, value) =>
    value?.prefixItems ? { ...value, items: value.prefixItems, prefixItems: undefined } : value,
  );
}
