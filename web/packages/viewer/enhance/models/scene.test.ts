/** Error messages only: tests/web/test_scene_network.py checks the pictures. */
import { expect, test } from "vitest";
import { LADDER, ONE, safetensors, weights } from "#fakes/weights";
import { EnhancementError } from "../model/enhancer";
import { SCENE } from "./scene";

const SOUND = safetensors(weights([ONE]).header, weights([ONE]).data);

/** A device that compiles nothing. */
const device = {
  features: new Set<string>(),
  createShaderModule: () => ({}),
  createComputePipelineAsync: () => Promise.reject(new Error("error: too many literals\n  at line 12")),
} as unknown as GPUDevice;

test.each([
  ["no weights", null, LADDER, "there are no weights for this scene."],
  ["weights for another ladder", SOUND, LADDER.slice(0, 1), /^its weights were trained for other frame sizes/],
  ["weights that are cut off", SOUND.slice(0, 300), LADDER, "its weights are truncated."],
  ["a GPU that refuses the shaders", SOUND, LADDER, "this graphics processor cannot run it."],
])("%s end in a sentence", async (_, file, ladder, message) => {
  const error: unknown = await SCENE.load(device, file, ladder).catch((reason: unknown) => reason);
  expect(error).toBeInstanceOf(EnhancementError);
  expect((error as Error).message).toMatch(message);
});
