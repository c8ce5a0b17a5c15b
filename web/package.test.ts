// @vitest-environment node
/** The npm package, as installed by another project. */
import { spawnSync } from "node:child_process";
import { mkdirSync, mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { brotliCompressSync } from "node:zlib";
import { afterAll, beforeAll, expect, test } from "vitest";

const PATIENCE = 120_000;
const WEB = import.meta.dirname;
const project = mkdtempSync(join(tmpdir(), "tigas-package-"));
const installed = join(project, "node_modules/@tigas/viewer");
/** The output of a program, errors included. */
const run = (program: string, ...args: string[]) => {
  const { stdout, stderr } = spawnSync(program, args, { cwd: project, encoding: "utf8" });
  return stdout + stderr;
};

beforeAll(() => {
  mkdirSync(installed, { recursive: true });
  run("node", join(WEB, "scripts/build-package.mjs"), installed);
  writeFileSync(join(project, "package.json"), '{ "type": "module" }');
}, PATIENCE);

afterAll(() => rmSync(project, { recursive: true }));

/** A module of the package with everything that it imports statically. */
function loaded(path: string, seen = new Set<string>()): Set<string> {
  if (seen.has(path)) return seen;
  seen.add(path);
  const text = readFileSync(join(installed, path), "utf8");
  for (const [, request] of text.matchAll(/(?:from|import)\s*["']([^"']+)["']/g)) {
    if (request) loaded(join(dirname(path), request), seen);
  }
  return seen;
}

test("can be imported where there is no document, and then does nothing", () => {
  const code = `
    import * as viewer from "@tigas/viewer";
    import * as element from "@tigas/viewer/element";
    console.log(Object.keys(viewer).join(), Object.keys(element).join());`;
  expect(run("node", "--input-type=module", "--eval", code).trim()).toBe("Viewer,createViewer TigasViewer");
});

test("loads at most 100 kB for pictures; players of other modes come on demand", () => {
  const modules = [...loaded("element.js")];
  const bytes = modules.map((path) => brotliCompressSync(readFileSync(join(installed, path))).length);
  expect(bytes.reduce((sum, size) => sum + size)).toBeLessThan(100_000);
  expect(modules.length).toBeGreaterThan(1);
  const chunks = readdirSync(join(installed, "chunks"));
  expect(chunks.some((name) => name.startsWith("dashjs-stream"))).toBe(true);
});

test("needs no other package, and no file beside its modules", () => {
  const { version } = JSON.parse(readFileSync(join(WEB, "package.json"), "utf8"));
  const description = JSON.parse(readFileSync(join(installed, "package.json"), "utf8"));
  expect(description).toMatchObject({ name: "@tigas/viewer", version, license: "MIT" });
  expect(description).not.toHaveProperty("dependencies");
  const files = readdirSync(installed, { recursive: true, encoding: "utf8" });
  expect(files.filter((name) => /worker|\.(css|html|svg)$/.test(name))).toEqual([]);
  expect(readFileSync(join(installed, "licenses.md"), "utf8")).toContain("@preact/signals-core");
});

test(
  "declares its types",
  () => {
    writeFileSync(
      join(project, "use.ts"),
      `import { createViewer, type ScenePose, type Viewer } from "@tigas/viewer";
     import "@tigas/viewer/element";
     const viewer: Viewer = createViewer(document.body, { scene: "garden", settings: { mode: "video" } });
     const pose: ScenePose = viewer.camera;
     viewer.on("frame", ({ rung }) => rung?.toFixed());
     export const there: Promise<boolean> = viewer.animate(pose, { easing: "ease-in" });
     document.querySelector("tigas-viewer")?.viewer?.set({ profile: 2 });
     // @ts-expect-error there is no such setting
     viewer.set({ magic: true });`,
    );
    const compilerOptions = { noEmit: true, strict: true, target: "es2023", module: "nodenext" };
    writeFileSync(join(project, "tsconfig.json"), JSON.stringify({ compilerOptions, files: ["use.ts"] }));
    const said = run(join(WEB, "node_modules/.bin/tsc"));
    expect(said).toBe("");
  },
  PATIENCE,
);
