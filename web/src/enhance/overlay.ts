/** A canvas over the element that shows frames as they come: there is none before its first frame is shown, and none after the last. */
export class Overlay {
  readonly #below: HTMLElement;
  #canvas: HTMLCanvasElement | undefined;

  constructor(below: HTMLElement) {
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
