/** State of one viewer, shared by its parts; two viewers on a page share nothing. */
import { computed, type Signal, signal } from "@preact/signals";
import type { Rung, ServerConfig } from "#client/wire/render";
import type { NamedMovement } from "../movement/movement-deck";
import { DEFAULT_SETTINGS, type Settings } from "./settings";

export class ViewerState {
  readonly settings: Signal<Settings>;
  readonly config: Signal<ServerConfig | null> = signal(null);
  /** The ladder of the visited scene, if it has its own. */
  readonly sceneLadder: Signal<readonly Rung[] | null> = signal(null);
  /**
   * The ladder that profiles index: the scene's own, or else the server's, best first; empty until the server has
   * answered.
   */
  readonly ladder = computed<readonly Rung[]>(() => this.sceneLadder.value ?? this.config.value?.ladder ?? []);
  /** Settings of an experiment are not stored: reopening the page restores the user's own. */
  readonly settingsOverridden = signal(false);
  /** The loaded movement, which stays from scene to scene. */
  readonly movement: Signal<NamedMovement | null> = signal(null);
  /** URL of the server without a trailing slash; empty for the page's own. */
  readonly server: string;

  constructor(settings: Partial<Settings> = {}, server = "") {
    this.settings = signal({ ...DEFAULT_SETTINGS, ...settings });
    this.server = server;
  }

  readonly change = (part: Partial<Settings>): void => {
    this.settings.value = { ...this.settings.value, ...part };
  };
}
