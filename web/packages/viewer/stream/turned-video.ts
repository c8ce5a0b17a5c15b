/**
 * A stream whose frames are warped to newer views: each frame is copied when the browser presents it, waits until its
 * view is known, and is then drawn to the canvas over the video. Until then the previous frame stays.
 */
import type { Reprojector } from "../reproject/reprojector";
import { resized } from "../reproject/view";
import type { Told } from "./camera-feed";

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

/** Properties of a frame on screen. */
export interface StreamedFrame {
  readonly rung: number | null;
  /** Encoded size in pixels. */
  readonly width: number;
  readonly height: number;
  /** Time of the view's request on the page's clock. */
  readonly askedAt: number;
}

export class TurnedVideo {
  readonly #video: HTMLVideoElement;
  readonly #reprojector: Reprojector<StreamedFrame>;
  readonly #waiting = new WaitingPictures<VideoFrame>();

  constructor(video: HTMLVideoElement, reprojector: Reprojector<StreamedFrame>) {
    this.#video = video;
    this.#reprojector = reprojector;
  }

  /** A browser that can say which of a video's frames it gives away. */
  static get supported(): boolean {
    return globalThis.VideoFrame !== undefined;
  }

  /**
   * Copies the video's present picture and returns the number of its frame, which `numberAt` knows by media time in
   * seconds; null without a picture. The picture may be newer than the frame that the browser has just reported at
   * `reported`, and must not be confused with it. Firefox does not say whether it is: as a timestamp, it gives seconds of
   * playback, not microseconds of the picture.
   */
  capture(reported: number, numberAt: (mediaTime: number) => number | null): number | null {
    let picture: VideoFrame;
    try {
      picture = new VideoFrame(this.#video);
    } catch {
      return null; // a video that is on its way to another place has none
    }
    const untimed = picture.timestamp === Math.trunc(this.#video.currentTime);
    const frame = numberAt(untimed ? reported : picture.timestamp / 1e6);
    if (frame === null) picture.close();
    else this.#waiting.add(frame, picture);
    return frame;
  }

  /** It is known which view a frame shows. */
  show(frame: number, told: Told, about: Omit<StreamedFrame, "askedAt">): void {
    const picture = this.#waiting.take(frame);
    if (picture === null) return;
    this.#reprojector.take(picture, {
      frame: { ...about, askedAt: told.at },
      pose: told.pose,
      asked: told.asked,
      view: resized(told.view, picture.displayWidth, picture.displayHeight),
      depth: null,
    });
    picture.close();
  }

  /** The stream has ended. */
  clear(): void {
    this.#waiting.clear();
  }
}
