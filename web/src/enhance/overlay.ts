/** The canvas for enhanced frames, over that for frames as they come: there is none before the first is shown, and none after the last. */
export class Overlay {
  readonly #below: HTMLCanvasElement;
  #canvas: HTMLCanvasElement | undefined;

  constructor(below: HTMLCanvasElement) {
    this.#below = below;
  }

  /** Made when it is first asked for. */
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
