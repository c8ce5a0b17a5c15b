// Builds the npm package @tigas/viewer: node scripts/build-package.mjs [FOLDER]
// With --served, only its modules, which the render service sends to pages of other origins, such as notebooks.
import { execFileSync } from "node:child_process";
import { copyFileSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join, relative, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { parseArgs } from "node:util";
import { build } from "vite";
import { compress } from "./compress.mjs";

const WEB = fileURLToPath(new URL("..", import.meta.url));
const VIEWER = join(WEB, "packages/viewer");
/** Modules of the package, by the names under which they are imported. */
const ENTRIES = { index: "create-viewer", element: "element" };

const { values, positionals } = parseArgs({ allowPositionals: true, options: { served: { type: "boolean" } } });
const folder = resolve(positionals[0] ?? join(WEB, "dist-package"));
await bundle();
if (!values.served) {
  declareTypes();
  describe();
}

async function bundle() {
  await build({
    root: WEB,
    configFile: false,
    logLevel: "warn",
    plugins: [inlineWorkers(), ...(values.served ? [compress()] : [])],
    // Only the page uses Preact, which @preact/signals would pull in.
    resolve: { tsconfigPaths: true, alias: { "@preact/signals": "@preact/signals-core" } },
    worker: { format: "es" },
    build: {
      outDir: folder,
      emptyOutDir: true,
      copyPublicDir: false,
      chunkSizeWarningLimit: 4000, // Anime4K's networks, loaded on demand
      license: { fileName: "licenses.md" },
      lib: {
        entry: Object.fromEntries(Object.entries(ENTRIES).map(([name, file]) => [name, join(VIEWER, `${file}.ts`)])),
        formats: ["es"],
      },
      rolldownOptions: { output: { chunkFileNames: "chunks/[name]-[hash].js", minify: true } },
    },
  });
}

/** A Vite plugin that inlines workers, since browsers refuse workers of another origin. */
function inlineWorkers() {
  const started = /new Worker\(\s*new URL\(("[^"]+"), import\.meta\.url\),/g;
  return {
    name: "inline-workers",
    enforce: "pre",
    transform(code, id) {
      if (!id.startsWith(join(WEB, "packages"))) return undefined;
      const imports = [];
      const inlined = code.replaceAll(started, (_, path) => {
        const name = `InlineWorker${imports.length}`;
        imports.push(`import ${name} from ${path.replace(/"$/, '?worker&inline"')};\n`);
        return `new ${name}(`;
      });
      return imports.length === 0 ? undefined : { code: imports.join("") + inlined, map: null };
    },
  };
}

/** Writes the declarations that the entries need; they import no other package. */
function declareTypes() {
  const all = mkdtempSync(join(tmpdir(), "tigas-types-"));
  try {
    execFileSync(join(WEB, "node_modules/.bin/tsc"), ["-p", "tsconfig.types.json", "--outDir", all], { cwd: WEB });
    const written = new Set();
    const write = (path) => {
      if (written.has(path)) return;
      written.add(path);
      const text = readFileSync(join(all, `${path}.d.ts`), "utf8").replaceAll(/from "([^"]+)"/g, (_, request) => {
        if (!/^[.#]/.test(request)) throw new Error(`${path}.d.ts needs the package ${request}`);
        const imported = request.startsWith("#") ? request.slice(1) : join(dirname(path), request);
        write(imported);
        const shortest = relative(dirname(path), imported);
        return `from "${shortest.startsWith(".") ? shortest : `./${shortest}`}.js"`;
      });
      const target = join(folder, "types", `${path}.d.ts`);
      mkdirSync(dirname(target), { recursive: true });
      writeFileSync(target, text);
    };
    for (const file of Object.values(ENTRIES)) write(`viewer/${file}`);
  } finally {
    rmSync(all, { recursive: true });
  }
}

function describe() {
  const { version, license } = JSON.parse(readFileSync(join(WEB, "package.json"), "utf8"));
  const entry = (name) => ({ types: `./types/viewer/${ENTRIES[name]}.d.ts`, default: `./${name}.js` });
  const description = {
    name: "@tigas/viewer",
    version,
    description: "Shows 3D Gaussian Splatting scenes that a TIGAS server renders, in any page.",
    license,
    type: "module",
    exports: { ".": entry("index"), "./element": entry("element") },
    sideEffects: ["./element.js"],
  };
  writeFileSync(join(folder, "package.json"), `${JSON.stringify(description, null, 2)}\n`);
  copyFileSync(join(WEB, "../LICENSE"), join(folder, "LICENSE"));
  copyFileSync(join(VIEWER, "README.md"), join(folder, "README.md"));
}
