// Regenerates src/wire.ts from the Python wire types; with --check it only says whether the file is up to date.
import { execFileSync } from "node:child_process";
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { compile } from "json-schema-to-typescript";

const target = fileURLToPath(new URL("../src/wire.ts", import.meta.url));
const venv = fileURLToPath(new URL("../../.venv/bin/python", import.meta.url));
const python = process.env.PYTHON ?? (existsSync(venv) ? venv : "python3");

// Pydantic writes draft 2020-12, the generator reads draft 4: a tuple's members are called `items` there.
const schema = JSON.parse(execFileSync(python, ["-m", "tigas_common.schema"], { encoding: "utf8" }), (_, value) =>
  value?.prefixItems ? { ...value, items: value.prefixItems, prefixItems: undefined } : value,
);
const generated = await compile(schema, "Wire", {
  additionalProperties: false,
  bannerComment: "// Generated from services/common/tigas_common/wire.py by `npm run wire`. Do not edit.",
});

if (!process.argv.includes("--check")) {
  writeFileSync(target, generated);
} else if (!existsSync(target) || readFileSync(target, "utf8") !== generated) {
  process.stderr.write(
    "web/src/wire.ts does not match the Python wire types: run `npm run wire` and commit the result.\n",
  );
  process.exit(1);
}
