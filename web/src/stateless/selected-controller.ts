/** The controller that the settings name. */
import { computed, type ReadonlySignal } from "@preact/signals";
import type { Controller } from "../abr/controller";
import { FixedController } from "../abr/fixed";
import { firstOffered, offering } from "../abr/offered";
import { seeded } from "../abr/random";
import { CONTROLLERS } from "../abr/registry";
import { ladder, settings } from "../state/app";
import type { Rung } from "../wire/render";

/**
 * Made anew only when the choice, the rungs that it may choose from or the seed changes: a controller learns as it goes. Its
 * random numbers follow from the seed, so that a run can be made again. `pixels`: how many the picture takes on the screen;
 * larger rungs are for a person to choose only.
 */
export function selectedController(
  seed: ReadonlySignal<number>,
  pixels: ReadonlySignal<number>,
): ReadonlySignal<Controller> {
  const content = computed(() => JSON.stringify(ladder.value)); // the configuration is read again and again
  const rungs = computed((): Rung[] => JSON.parse(content.value));
  const first = computed(() => firstOffered(rungs.value, pixels.value));
  const name = computed(() => settings.value.controller);
  const chosen = computed(() => settings.value.profile);
  return computed(() => {
    if (name.value !== "fixed" && rungs.value.length > 0) {
      const context = { ladder: rungs.value, random: seeded(seed.value) };
      return offering(CONTROLLERS[name.value].create, context, first.value);
    }
    // The chosen rung, or the last if the ladder is shorter.
    return new FixedController(Math.min(chosen.value, Math.max(0, rungs.value.length - 1)));
  });
}
