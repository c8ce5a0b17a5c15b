/** The controller that the settings name. */
import { computed, type ReadonlySignal } from "@preact/signals";
import { type Controller, FixedController } from "#client/abr/controller";
import { firstOffered, offering } from "#client/abr/ladder";
import { seeded } from "#client/abr/random";
import { CONTROLLERS } from "#client/abr/registry";
import { stepOfBitrate, stepOfRung, type VideoStep, videoLadder } from "#client/abr/video-ladder";
import type { Rung } from "#client/wire/render";
import type { SideSettings } from "../state/settings";

type Ladder = ReadonlySignal<readonly Rung[]>;

/** The ladder, which changes only with its content, as the configuration is read repeatedly. */
function contentOf(ladder: Ladder): Ladder {
  const content = computed(() => JSON.stringify(ladder.value));
  return computed(() => JSON.parse(content.value));
}

/** The controller's ladder for a video; null for single pictures, which use the server's. `pixels`: see the controller. */
export function videoSteps(
  video: boolean,
  settings: ReadonlySignal<SideSettings>,
  ladder: Ladder,
  pixels: ReadonlySignal<number>,
): ReadonlySignal<readonly VideoStep[] | null> {
  const rungs = contentOf(ladder);
  const adapts = computed(() => settings.value.controller !== "fixed");
  const first = computed(() => (adapts.value ? firstOffered(rungs.value, pixels.value) : 0));
  const bitrate = computed(() => settings.value.bitrateKbps ?? null);
  return computed(() => {
    if (!video) return null;
    return bitrate.value === null ? videoLadder(rungs.value, first.value) : stepOfBitrate(rungs.value, bitrate.value);
  });
}

/**
 * Created again only when the choice, its rungs or the seed changes, because a controller learns as it goes. Its random
 * numbers follow from the seed, so that a run can be repeated. `pixels`: how many the picture takes on the screen;
 * larger rungs can only be chosen by the user.
 */
export function selectedController(
  settings: ReadonlySignal<SideSettings>,
  ladder: Ladder,
  seed: ReadonlySignal<number>,
  pixels: ReadonlySignal<number>,
  videoSteps: ReadonlySignal<readonly VideoStep[] | null>,
): ReadonlySignal<Controller> {
  const rungs = contentOf(ladder);
  const choices = computed(() => videoSteps.value ?? rungs.value);
  const first = computed(() => firstOffered(choices.value, pixels.value));
  const name = computed(() => settings.value.controller);
  const chosen = computed(() => settings.value.profile);
  return computed(() => {
    if (name.value !== "fixed" && choices.value.length > 0) {
      const context = { ladder: choices.value, random: seeded(seed.value) };
      return offering(CONTROLLERS[name.value].create, context, first.value);
    }
    // The chosen rung, or the last if the ladder is shorter.
    const rung = Math.min(chosen.value, Math.max(0, rungs.value.length - 1));
    const steps = videoSteps.value;
    const size = rungs.value[rung];
    return new FixedController(steps && size ? stepOfRung(steps, size) : rung);
  });
}
