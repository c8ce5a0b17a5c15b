/**
 * Packages import only those below them, and folders form no cycles, types included: each can be read without the ones
 * above it. Tests may also import fakes.
 */
import { alg, Graph } from "@dagrejs/graphlib";
import { parseSync } from "vite";
import { expect, test } from "vitest";

/** All files by path, such as `./packages/viewer/view/rig.ts`. */
const SOURCES = import.meta.glob<string>(["./{app,packages,tools}/**/*.{ts,tsx}"], {
  query: "?raw",
  import: "default",
  eager: true,
});

/** Static, re-exported and dynamic imports of a file, as paths without an extension. */
function importsOf(path: string, source: string): string[] {
  const { module } = parseSync(path, source);
  return [
    ...module.staticImports.map(({ moduleRequest }) => moduleRequest.value),
    ...module.staticExports.flatMap(({ entries }) =>
      entries.flatMap(({ moduleRequest }) => moduleRequest?.value ?? []),
    ),
    ...module.dynamicImports.map(({ moduleRequest: { start, end } }) => source.slice(start + 1, end - 1)),
  ]
    .filter((request) => /^[.#]/.test(request))
    .map((request) => request.replace("#fakes", "/tools/fakes").replace("#", "/packages/"))
    .map((request) => new URL(request, `file:/${path}`).pathname.slice(1));
}

const isTest = (path: string) => /\.test\.tsx?$/.test(path);

/** The cycles of folders; `folderOf` maps a path to its folder. */
function cycles(folderOf: (path: string) => string, sources: Readonly<Record<string, string>> = SOURCES): string[][] {
  const graph = new Graph();
  for (const [path, source] of Object.entries(sources)) {
    if (isTest(path)) continue;
    const from = folderOf(path.slice(2));
    for (const imported of importsOf(path, source)) {
      const to = folderOf(imported);
      if (from !== to) graph.setEdge(from, to);
    }
  }
  return alg.findCycles(graph);
}

const own = (path: string) => path.split("/").slice(0, -1).join("/");
/** Folder of a package, or of the page. */
const top = (path: string) =>
  path
    .split("/")
    .slice(0, -1)
    .slice(0, path.startsWith("packages") ? 3 : 2)
    .join("/");
const packageOf = (path: string) => path.match(/^(?:packages\/)?(\w+)/)?.[1] ?? "";

test("no folder imports itself by way of others", () => {
  expect(cycles(own)).toEqual([]);
});

test("nor does any with the folders that it holds", () => {
  expect(cycles(top)).toEqual([]);
});

test.each([
  ["client", ["client"]],
  ["viewer", ["client", "viewer"]],
  ["lab", ["client", "viewer", "lab"]],
  ["app", ["client", "viewer", "lab", "app"]],
])("%s imports only packages below it", (name, allowed) => {
  const files = Object.entries(SOURCES).filter(([path]) => packageOf(path.slice(2)) === name);
  expect(files.length).toBeGreaterThan(20);
  const wrong = files.flatMap(([path, source]) =>
    importsOf(path, source)
      .filter((to) => /^(app|packages|tools)\//.test(to) && !allowed.includes(packageOf(to)))
      .filter((to) => !(isTest(path) && to.startsWith("tools/fakes/")))
      .map((to) => `${path} imports ${to}`),
  );
  expect(wrong).toEqual([]);
});

test.each([
  ["a type", 'import type { B } from "../b/b"'],
  ["a name that is a type", 'import { type B } from "../b/b"'],
  ["what is passed on", 'export { B } from "../b/b"'],
  ["what is loaded on demand", 'await import("../b/b")'],
])("%s counts", (_, source) => {
  const sources = { "./a/a.ts": source, "./b/b.ts": 'import { a } from "../a/a"' };
  expect(cycles(own, sources).map((cycle) => cycle.toSorted())).toEqual([["a", "b"]]);
});
