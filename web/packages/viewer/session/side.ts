/** One picture of the scene with its own settings: the whole stage, or one side of a comparison. */
import { computed, effect, type ReadonlySignal, signal, untracked } from "@preact/signals";
import { Listeners } from "#client/async/listeners";
import type { Connected } from "#client/transport/connect";
import { reprojectionNote } from "../reproject/reprojector";
import { SOURCES } from "../sources/registry";
import type { Source, SourceContext, SourceKind, SourceStats } from "../sources/source";
import type { PresentedFrame } from "../view/presented";

export interface SideOptions extends Omit<SourceContext, "connection" | "size" | "onPresented" | "onReceived"> {
  /** Whether the page has been hidden for some time. */
  readonly left: ReadonlySignal<boolean>;
}

export class Side {
  readonly settings: SourceContext["settings"];
  /** Kind of its mode. */
  readonly kind: ReadonlySignal<SourceKind>;
  /** Source of the mode; null until the scene is known, and if the mode is not available. */
  readonly source = signal<Source | null>(null);
  /** Why the mode is not available; null if it is. */
  readonly missing: ReadonlySignal<string | null>;
  readonly unturned = computed(() => reprojectionNote(this.source.value?.reprojection.value ?? "off"));
  /** The mode, if its code could not be loaded. */
  readonly #unloaded = signal<SourceKind | null>(null);
  readonly #connection = signal<Connected | null>(null);
  readonly #presented = new Listeners<[PresentedFrame]>();
  /** Subscribes to every frame on screen; returns a function that unsubscribes. */
  readonly onPresented = this.#presented.add;
  readonly #stop: () => void;
  #received = 0;

  constructor(options: SideOptions) {
    const { rig, pixelRatio, settings, scene, config } = options;
    this.settings = settings;
    const context: SourceContext = {
      ...options,
      connection: this.#connection,
      size: () => {
        const { width, height } = rig.viewport.peek();
        const ratio = pixelRatio.peek();
        return { width: Math.round(width * ratio), height: Math.round(height * ratio) };
      },
      onPresented: this.#presented.tell,
      onReceived: (bytes) => {
        this.#received += bytes;
      },
    };
    this.kind = computed(() => SOURCES[settings.value.mode]);
    this.missing = computed(() => {
      if (this.#unloaded.value === this.kind.value) return "This mode could not be loaded; reload the page";
      return scene.value === null ? null : this.kind.value.missing(config.value, scene.value);
    });
    const available = computed(
      () =>
        scene.value !== null &&
        (this.kind.value.requests || scene.value.state !== "loading") && // other modes have no coarse pictures
        rig.viewport.value.width > 1 && // the stage has been laid out
        this.missing.value === null &&
        (this.kind.value.keepsHidden || !options.left.value),
    );
    const form = computed(() => settings.value.localForm);
    this.#stop = effect(() => {
      const { value: kind } = this.kind;
      if (!available.value) return undefined;
      if (kind.drawsHere) void form.value; // another form is another download
      return untracked(() => this.#open(kind, context));
    });
  }

  /** Opens a source of the mode once its code is loaded; returns a function that closes it. */
  #open(kind: SourceKind, context: SourceContext): () => void {
    let closed = false;
    kind.load().then(
      (open) => {
        if (!closed) this.source.value = open(context);
      },
      () => {
        if (!closed) this.#unloaded.value = kind;
      },
    );
    return () => {
      closed = true;
      const source = this.source.peek();
      this.source.value = null;
      source?.dispose();
    };
  }

  get receivedBytes(): number {
    return this.#received;
  }

  get figures(): SourceStats | null {
    return this.source.value?.stats.value ?? null;
  }

  /** Requests views over this connection from now on; null while there is none. */
  attach(connected: Connected | null): void {
    this.#connection.value = connected;
  }

  picture(): Promise<ImageBitmap> | null {
    return this.source.peek()?.picture() ?? null;
  }

  dispose(): void {
    this.#stop();
  }
}
