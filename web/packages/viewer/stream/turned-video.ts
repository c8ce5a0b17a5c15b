/**
 * A stream whose frames are warped to newer views: each frame is copied when the browser presents it, waits until its
 * view is known, and is then drawn to the canvas over the video. Until then the previous frame stays.
 */
import type { Reprojector } from "../reproject/reprojector";
import { resized } from "../reproject/view";
import type { Told } from "./camera-feed";

/** The most waiting pictures, since a decoder lends only a few. */
const MOST = 3;

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
  /** Pictures of unknown views, by the frames' numbers, which increase unless the video jumps. */
  readonly #waiting = new Map<number, VideoFrame>();

  constructor(video: HTMLVideoElement, reprojector: Reprojector<StreamedFrame>) {
    this.#video = video;
    this.#reprojector = reprojector;
  }

  /** Whether the browser can identify the frames that it copies from a video. */
  static get supported(): boolean {
    return globalThis.VideoFrame !== undefined;
  }

  /**
   * Copies the video's current picture and returns the number of its frame, which `numberAt` knows by media time in
   * seconds; null without a picture. The picture may be newer than the frame that the browser has just reported at
   * `reported`, and must not be confused with it. Firefox does not say whether it is: as a timestamp, it gives seconds of
   * playback, not microseconds of the picture.
   */
  capture(reported: number, numberAt: (mediaTime: number) => number | null): number | null {
    let picture: VideoFrame;
    try {
      picture = new VideoFrame(this.#video);
    } catch {
      return null; // a seeking video has none
    }
    const untimed = picture.timestamp === Math.trunc(this.#video.currentTime);
    const frame = numberAt(untimed ? reported : picture.timestamp / 1e6);
    if (frame === null) picture.close();
    else this.#wait(frame, picture);
    return frame;
  }

  /** Shows a frame, once its view is known. */
  show(frame: number, told: Told, about: Omit<StreamedFrame, "askedAt">): void {
    const picture = this.#waiting.get(frame);
    if (picture === undefined) return;
    for (const earlier of this.#waiting.keys()) {
      if (earlier === frame) break;
      this.#drop(earlier);
    }
    this.#reprojector.take(picture, {
      frame: { ...about, askedAt: told.at },
      pose: told.pose,
      asked: told.asked,
      view: resized(told.view, picture.displayWidth, picture.displayHeight),
      depth: null,
    });
    this.#drop(frame);
  }

  /** Drops all pictures at the end of a stream. */
  clear(): void {
    for (const frame of this.#waiting.keys()) this.#drop(frame);
  }

  #wait(frame: number, picture: VideoFrame): void {
    this.#drop(frame);
    this.#waiting.set(frame, picture);
    for (const oldest of this.#waiting.keys()) {
      if (this.#waiting.size <= MOST) break;
      this.#drop(oldest);
    }
  }

  #drop(frame: number): void {
    this.#waiting.get(frame)?.close();
    this.#waiting.delete(frame);
  }
}
