// Regenerates the TypeScript and the tables of docs/protocol.md from the Python wire types; with --check, only reports whether
// they are up to date.
import { execFileSync } from "node:child_process";
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { compile } from "json-schema-to-typescript";

/** `packages/client/wire/NAME.ts` is generated from `wire/NAME.py` of a package, whose `wire.schema` prints schemas and constants. */
const NAMES = { render: "common", dash: "common", shaper: "common", store: "experiments" };

/** Definitions whose fields no page reads. */
const UNREAD = ["Figures"];
/** A generated definition with its comment. */
const DEFINITION = /(?:\/\*\*\n(?: \*.*\n)+)?export (?:interface|type) (\w+)(?: = .*;\n| {\n[\s\S]*?\n}\n)/g;

const venv = fileURLToPath(new URL("../../.venv/bin/python", import.meta.url));
const python = process.env.PYTHON ?? (existsSync(venv) ? venv : "python3");

/** The module that defines a type, by the type's definition. */
const homes = new Map();
for (const [name, owner] of Object.entries(NAMES)) {
  const generated = await compile(schemaOf(name, owner), name, { additionalProperties: false, bannerComment: "" });
  keep(`web/packages/client/wire/${name}.ts`, `${banner(name, owner)}\n\n${definitionsOf(generated, name)}`);
}
for (const [name, constants] of Object.entries(JSON.parse(print("constants", "experiments")))) {
  const lines = Object.entries(constants).map(([constant, value]) => `export const ${constant} = ${literal(value)};\n`);
  keep(`web/packages/client/wire/${name}.ts`, `${banner(name, "experiments")}\n\n${lines.join("")}`);
}
const tables = JSON.parse(print("tables", "common"));
const protocol = "docs/protocol.md";
keep(
  protocol,
  readFileSync(pathOf(protocol), "utf8").replaceAll(
    /(<!-- fields of (\w+) -->\n).*?(<!-- end -->)/gs,
    (_, begin, model, end) => `${begin}${tables[model]}\n${end}`,
  ),
);

function keep(file, generated) {
  const target = pathOf(file);
  if (!process.argv.includes("--check")) {
    writeFileSync(target, generated);
  } else if (!existsSync(target) || readFileSync(target, "utf8") !== generated) {
    process.stderr.write(`${file} does not match the Python wire types: run \`npm run wire\` and commit the result.\n`);
    process.exitCode = 1;
  }
}

/** The definitions of a module; definitions of earlier modules are imported from there. */
function definitionsOf(generated, name) {
  const plain = generated
    .replace(/export interface Messages {.*?\n}\n/s, "")
    .replaceAll(/ *\/\*\*\n(?: *\* @m(?:in|ax)Items \d+\n)+ *\*\/\n/g, "");
  const definitions = [...plain.matchAll(DEFINITION)];
  const own = definitions.filter(([definition]) => !homes.has(definition));
  const text = own.map(([definition]) => definition.replace(/\/\*\*\n \* (.*)\n \*\/\n/, "/** $1 */\n")).join("");
  const used = definitions.filter(([definition, type]) => homes.has(definition) && text.match(`\\b${type}\\b`));
  const imports = [...new Set(used.map(([definition]) => homes.get(definition)))].map((home) => {
    const types = used.filter(([definition]) => homes.get(definition) === home).map(([, type]) => type);
    return `import type { ${types.toSorted().join(", ")} } from "./${home}";\n`;
  });
  for (const [definition] of own) homes.set(definition, name);
  return imports.length > 0 ? `${imports.join("")}\n${text}` : text;
}

/** A constant, of a literal type. */
function literal(value) {
  return value !== null && typeof value === "object" ? `${formatted(value)} as const` : JSON.stringify(value);
}

/** JSON as Biome formats TypeScript: on one line if it fits. */
function formatted(value, indent = "") {
  if (value === null || typeof value !== "object") return JSON.stringify(value);
  const inner = `${indent}  `;
  const key = (name) => (/^\w+$/.test(name) ? name : JSON.stringify(name));
  const entries = Array.isArray(value)
    ? value.map((entry) => formatted(entry, inner))
    : Object.entries(value).map(([name, entry]) => `${key(name)}: ${formatted(entry, inner)}`);
  const [open, close] = Array.isArray(value) ? ["[", "]"] : ["{ ", " }"];
  const line = `${open}${entries.join(", ")}${close}`;
  if (line.length < 90) return line;
  return `${open.trim()}\n${entries.map((entry) => `${inner}${entry},\n`).join("")}${indent}${close.trim()}`;
}

function banner(name, owner) {
  return `// Generated from services/${owner}/tigas_${owner}/wire/${name}.py by \`npm run wire\`. Do not edit.`;
}

function pathOf(file) {
  return fileURLToPath(new URL(`../../${file}`, import.meta.url));
}

function print(name, owner) {
  return execFileSync(python, ["-m", `tigas_${owner}.wire.schema`, name], { encoding: "utf8" });
}

// Pydantic writes draft 2020-12, the generator reads draft 4: a tuple's members are called `items` there. The generator would
// list the possible lengths of other arrays.
function schemaOf(name, owner) {
  return JSON.parse(print(name, owner), (key, value) => {
    if (UNREAD.includes(key)) return value.type === "object" ? {} : value;
    if (value?.prefixItems) return { ...value, items: value.prefixItems, prefixItems: undefined };
    if (value?.type !== "array") return value;
    const { minItems: _, maxItems: __, ...any } = value;
    return any;
  });
}
