/** Pictures of a video's frames, each kept until its view is known, and closed if unused. */

export class WaitingPictures<Picture extends { close(): void }> {
  /** A decoder has few pictures to lend. */
  static readonly MOST = 3;
  /** By the frames' numbers, which grow unless the video jumps. */
  readonly #waiting = new Map<number, Picture>();

  /** The newest frame's. */
  add(frame: number, picture: Picture): void {
    this.#drop(frame);
    this.#waiting.set(frame, picture);
    for (const oldest of this.#waiting.keys()) {
      if (this.#waiting.size <= WaitingPictures.MOST) break;
      this.#drop(oldest);
    }
  }

  /** Removes and returns a frame's picture, dropping earlier ones; null if it was dropped. */
  take(frame: number): Picture | null {
    const picture = this.#waiting.get(frame);
    if (picture === undefined) return null;
    for (const earlier of this.#waiting.keys()) {
      if (earlier === frame) break;
      this.#drop(earlier);
    }
    this.#waiting.delete(frame);
    return picture;
  }

  clear(): void {
    for (const frame of this.#waiting.keys()) this.#drop(frame);
  }

  #drop(frame: number): void {
    this.#waiting.get(frame)?.close();
    this.#waiting.delete(frame);
  }
}
