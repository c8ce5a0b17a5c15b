import { signal } from "@preact/signals";
import { expect, test, vi } from "vitest";
import { COURTYARD } from "#fakes/server";
import { DEFAULT_SETTINGS } from "../state/settings";
import { keepTurning } from "./keep-turning";

test("coarse pictures of a scene that loads are turned no more once it is loaded", () => {
  const reprojector = { on: vi.fn(), off: vi.fn() };
  const settings = signal({ ...DEFAULT_SETTINGS, mode: "stateless" as const, reprojection: true });
  const scene = signal({ ...COURTYARD, state: "loading" as "loading" | "loaded" });
  const stop = keepTurning(reprojector, settings, scene);
  scene.value = { ...COURTYARD, state: "loading", name: "Another name" };
  expect(reprojector.on).toHaveBeenCalledTimes(1);
  scene.value = { ...COURTYARD, state: "loaded" };
  expect(reprojector.on).toHaveBeenCalledTimes(2); // which restarts
  stop();
});
