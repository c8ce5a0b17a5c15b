import { expect, test } from "vitest";
import type { SceneInfo } from "#client/wire/render";
import { whatIsNew } from "./news";

function scene(id: string, rest: Partial<SceneInfo> = {}): SceneInfo {
  return { id, name: id, state: "unloaded", error: null, file_bytes: 10, ...rest } as SceneInfo;
}

const broken = (id: string, error = "It is truncated.") => scene(id, { state: "broken", error });

test("says that nothing has changed, whatever is loaded meanwhile", () => {
  const before = [scene("a"), broken("b")];
  expect(whatIsNew(before, [scene("a", { state: "loaded" }), broken("b")])).toBe("No changes.");
});

test("names what came, changed, broke and went, and counts what is too much to name", () => {
  const before = [scene("kept"), scene("grown"), scene("spoilt"), broken("mended"), scene("gone")];
  const after = [
    scene("kept"),
    scene("grown", { file_bytes: 20 }),
    broken("spoilt"),
    scene("mended"),
    ...["v", "w", "x", "y", "z"].map((id) => scene(id)),
    broken("odd"),
  ];
  expect(whatIsNew(before, after)).toBe(
    "New: v, w, x and 2 more. Changed: grown, mended. Broken: spoilt, odd. Removed: gone.",
  );
});
