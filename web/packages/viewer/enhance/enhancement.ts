/**
 * The chosen models on a working device: loaded in the background while the previous ones continue, restarted once
 * after a lost device, and dropped with a message if unusable.
 */
import { type ReadonlySignal, signal } from "@preact/signals";
import type { Chain, Place } from "./chain";
import { openDevice } from "./device";
import { EnhancementError, type Enhancer, firstLine } from "./model/enhancer";
import type { Overlay } from "./overlay";
import type { Picture, Renderer } from "./renderer";

export type EnhancementStatus =
  | { readonly kind: "off" }
  | { readonly kind: "starting"; readonly message: string | null }
  | { readonly kind: "on"; readonly labels: Chain["labels"] }
  /** Switched off automatically until the next choice. */
  | { readonly kind: "failed"; readonly message: string };

/** The renderer and its models. */
export interface Active {
  readonly renderer: Renderer;
  readonly chain: Chain;
}

export interface EnhancementOptions {
  /** Where enhanced frames are drawn. */
  readonly overlay: Overlay;
  readonly open?: () => Promise<GPUDevice>;
}

interface Opened {
  readonly device: GPUDevice;
  readonly renderer: Renderer;
}

const LOST = "The graphics processor was lost";

export class Enhancement {
  readonly #status = signal<EnhancementStatus>({ kind: "off" });
  readonly #options: Required<EnhancementOptions>;
  #choice: { readonly models: readonly Enhancer[]; readonly place: Place } | undefined;
  #starting = new AbortController();
  #opened: Promise<Opened> | undefined;
  /** Identifies the active device: losses and errors of others are ignored. */
  #turn = {};
  #active: Active | null = null;
  #picture: Picture | undefined;
  #retried = false;
  /** Called whenever `active` changes. */
  onChange: () => void = () => undefined;

  constructor(options: EnhancementOptions) {
    this.#options = { open: openDevice, ...options };
  }

  get status(): ReadonlySignal<EnhancementStatus> {
    return this.#status;
  }

  /** Null while frames are shown without enhancement. */
  get active(): Active | null {
    return this.#active;
  }

  /** Switches to these models once they are ready. */
  choose(models: readonly Enhancer[], place: Place): void {
    this.#retried = false;
    this.#choice = { models, place };
    void this.#start(null);
  }

  /** Reloads the models for the current sizes of pictures. */
  renew(): void {
    if (this.#status.peek().kind === "on") void this.#start(null);
  }

  /** Shows frames without enhancement. */
  off(): void {
    this.#end({ kind: "off" });
  }

  /** Remembers a recent picture; a model that is loading prepares for its size first. */
  seen(picture: Picture): void {
    this.#picture = picture;
  }

  /** Shows frames without enhancement until the next choice, and reports why. */
  giveUp(message: string): void {
    this.#end({ kind: "failed", message });
  }

  dispose(): void {
    this.onChange = () => undefined;
    this.#end({ kind: "off" });
  }

  async #start(message: string | null): Promise<void> {
    if (this.#choice === undefined) return;
    const { models, place } = this.#choice;
    this.#starting.abort();
    const starting = new AbortController();
    this.#starting = starting;
    const { signal } = starting;
    this.#status.value = { kind: "starting", message };
    try {
      this.#opened ??= this.#open();
      const { device, renderer } = await this.#opened;
      signal.throwIfAborted();
      const { Chain } = await import("./chain");
      const chain = await Chain.load(device, models, place, signal);
      try {
        if (this.#picture) await renderer.warmUp(chain, this.#picture);
        signal.throwIfAborted();
      } catch (error) {
        chain.dispose();
        throw error;
      }
      const before = this.#active;
      this.#active = { renderer, chain };
      this.#status.value = { kind: "on", labels: chain.labels };
      this.onChange();
      before?.chain.dispose();
    } catch (error) {
      if (!signal.aborted) this.giveUp(sentence(error));
    }
  }

  async #open(): Promise<Opened> {
    const turn = {};
    this.#turn = turn;
    const mine = () => this.#turn === turn;
    const device = await this.#options.open();
    void device.lost.then(() => mine() && this.#lost());
    device.addEventListener("uncapturederror", (event) => {
      event.preventDefault(); // reported here
      if (mine()) this.giveUp(`${this.#label()} failed: ${firstLine(event.error.message)}`);
    });
    try {
      const { overlay } = this.#options;
      const { Renderer } = await import("./renderer");
      return { device, renderer: new Renderer(device, overlay.canvas) };
    } catch (error) {
      device.destroy();
      throw error;
    }
  }

  #lost(): void {
    this.#opened = undefined;
    this.#turn = {};
    this.#release();
    if (this.#retried) {
      this.giveUp(`${LOST} again.`);
      return;
    }
    this.#retried = true;
    void this.#start(`${LOST}; restarting.`);
  }

  #end(status: EnhancementStatus): void {
    this.#choice = undefined;
    this.#starting.abort();
    const opened = this.#opened;
    this.#opened = undefined;
    this.#turn = {};
    this.#release();
    void opened?.then(
      ({ device }) => device.destroy(),
      () => undefined, // already reported
    );
    this.#status.value = status;
  }

  #release(): void {
    const before = this.#active;
    if (before === null) return;
    this.#active = null;
    this.onChange();
    before.chain.dispose();
  }

  #label(): string {
    return this.#choice?.models.map(({ label }) => label).join(" + ") ?? "";
  }
}

function sentence(error: unknown): string {
  if (error instanceof EnhancementError) return error.message;
  return `Enhancement does not work here: ${error instanceof Error ? error.message : String(error)}`;
}
