import { expect, test } from "vitest";
import type { SceneInfo } from "#client/wire/render";
import { filterScenes } from "./filter";

const scene = (id: string, name: string) => ({ id, name }) as SceneInfo;
const SCENES = [scene("courtyard", "Courtyard"), scene("cafe-2", "Café at night"), scene("garden", "Rose garden")];

test.each([
  ["", 3],
  ["   ", 3],
  ["COURT", 1],
  ["cafe", 1],
  ["night café", 1],
  ["garden rose", 1],
  ["ar", 2],
  ["nothing like it", 0],
])("“%s” finds %i", (text, found) => {
  expect(filterScenes(SCENES, text)).toHaveLength(found);
});
