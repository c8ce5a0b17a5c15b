import { expect, test } from "vitest";
import { KINDS } from "./model/enhancer";
import { chosenEnhancers, ENHANCERS, nameProblem } from "./registry";

test("every name can stand in a URL, an experiment's file and a folder's name, and is there once", () => {
  const names = ENHANCERS.map(({ name }) => name);
  expect(names.filter((name) => !/^[a-z0-9][a-z0-9-]{0,23}$/.test(name))).toEqual([]);
  expect(new Set([...names, "off"]).size).toBe(names.length + 1);
});

test("frames are restored before they are enlarged", () => {
  const chosen = chosenEnhancers({ upscale: "anime4k-upscale-m", restore: "anime4k-restore-vl" });
  expect(chosen.map(({ kind }) => kind)).toEqual([...KINDS]);
});

test("off is no model, and nothing of another kind is found", () => {
  expect(chosenEnhancers({ restore: "off", upscale: "off" })).toEqual([]);
  expect(chosenEnhancers({ restore: "bicubic", upscale: "anime4k-restore-m" })).toEqual([]);
});

test("a name that is unknown is told with those that are", () => {
  expect(nameProblem("upscale", "bicubic")).toBeNull();
  expect(nameProblem("restore", "off")).toBeNull();
  expect(nameProblem("restore", "bicubic")).toMatch(
    /^Unknown restore model “bicubic”: use off, anime4k-restore-m, .+\.$/,
  );
});
