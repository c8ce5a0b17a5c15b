/** A canvas over the element with plain frames: created with its first frame, removed after the last. */
export class Overlay {
  readonly #below: HTMLElement;
  #canvas: HTMLCanvasElement | undefined;

  constructor(below: HTMLElement) {
    this.#below = below;
  }

  /** Created on first use. */
  get canvas(): HTMLCanvasElement {
    this.#canvas ??= this.#below.ownerDocument.createElement("canvas");
    return this.#canvas;
  }

  show(): void {
    if (!this.canvas.isConnected) this.#below.after(this.canvas);
  }

  hide(): void {
    this.#canvas?.remove();
  }
}
