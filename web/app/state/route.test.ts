import { expect, test } from "vitest";
import { EXPERIMENTS, parseRoute, runHash, samplesHash, sceneHash } from "./route";

test.each(["courtyard", "my scene", "a/b", "ünï", "100%", "#?&"])("a link to the scene %s leads to it", (scene) => {
  expect(parseRoute(sceneHash(scene))).toEqual({ page: "viewer", scene, asked: {} });
});

test.each([
  ["?restore=anime4k-restore-m&upscale=scene", { restore: "anime4k-restore-m", upscale: "scene" }],
  ["?upscale", { upscale: "" }],
  ["?reprojection=off&prediction=linear", { reprojection: "off", prediction: "linear" }],
  ["?left=video&right=dash-edge", { left: "video", right: "dash-edge" }],
  ["?", {}],
])("a link with %s names settings", (query, asked) => {
  expect(parseRoute(`#/scene/courtyard${query}`)).toEqual({ page: "viewer", scene: "courtyard", asked });
});

test("what a link names and nobody knows is told", () => {
  expect(parseRoute("#/scene/courtyard?predicton=linear&upscale=scene&x")).toEqual({
    page: "viewer",
    scene: "courtyard",
    asked: { upscale: "scene" },
    unknown: ["predicton", "x"],
  });
});

test.each(["", "#", "#/", "#/scene/", "#/scene/a/b", "#/other", "#/scene/%E0%A4%A"])(
  "%s is the list of scenes",
  (hash) => {
    expect(parseRoute(hash)).toEqual({ page: "scenes" });
  },
);

test("experiments have a list of their own, beside a scene of that name", () => {
  expect(parseRoute(EXPERIMENTS)).toEqual({ page: "experiments" });
  expect(parseRoute(sceneHash("experiments"))).toMatchObject({ page: "viewer" });
});

test.each(["two-1", "a/b", "100%"])("the experiment %s has pages for its samples and its runs", (experiment) => {
  expect(parseRoute(samplesHash(experiment))).toEqual({ page: "samples", experiment });
  expect(parseRoute(runHash(experiment))).toEqual({ page: "run", experiment });
});

test("a link can hide the controls", () => {
  expect(parseRoute("#/scene/a?noui&mode=local")).toEqual({
    page: "viewer",
    scene: "a",
    asked: { mode: "local" },
    bare: true,
  });
});
