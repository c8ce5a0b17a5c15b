import { expect, test } from "vitest";
import { parseRoute, sceneHash } from "./route";

test.each(["courtyard", "my scene", "a/b", "ünï", "100%", "#?&"])("a link to the scene %s leads to it", (scene) => {
  expect(parseRoute(sceneHash(scene))).toEqual({ page: "viewer", scene });
});

test.each(["", "#", "#/", "#/scene/", "#/scene/a/b", "#/other", "#/scene/%E0%A4%A"])(
  "%s is the list of scenes",
  (hash) => {
    expect(parseRoute(hash)).toEqual({ page: "scenes" });
  },
);
