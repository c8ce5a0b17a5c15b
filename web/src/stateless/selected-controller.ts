/** The controller that the settings name. */
import { computed, type ReadonlySignal } from "@preact/signals";
import type { Controller } from "../abr/controller";
import { FixedController } from "../abr/fixed";
import { seeded } from "../abr/random";
import { CONTROLLERS } from "../abr/registry";
import { config, settings } from "../state/app";
import type { Rung } from "../wire/render";

/**
 * Made anew only when the choice, the ladder or the seed changes: a controller learns as it goes. Its random numbers follow
 * from the seed, so that a run can be made again.
 */
export function selectedController(seed: ReadonlySignal<number>): ReadonlySignal<Controller> {
  const ladder = computed(() => JSON.stringify(config.value?.ladder ?? [])); // the configuration is read again and again
  const name = computed(() => settings.value.controller);
  const chosen = computed(() => settings.value.profile);
  return computed(() => {
    const rungs: Rung[] = JSON.parse(ladder.value);
    if (name.value !== "fixed" && rungs.length > 0) {
      return CONTROLLERS[name.value].create({ ladder: rungs, random: seeded(seed.value) });
    }
    // The chosen rung, or the last if the server's ladder is shorter.
    return new FixedController(Math.min(chosen.value, Math.max(0, rungs.length - 1)));
  });
}
