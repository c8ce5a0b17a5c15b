/**
 * A stream whose frames are turned to newer views: each one's picture is taken from the video when the browser presents it, waits
 * until it is known which view it shows, and goes to the canvas over the video. Until then the one before stays.
 */
import type { Reprojector } from "../reproject/reprojector";
import { resized } from "../reproject/view";
import type { Told } from "./camera-feed";
import { WaitingPictures } from "./waiting-pictures";

/** What is told of a frame when it is on the screen. */
export interface StreamedFrame {
  readonly rung: number | null;
  /** Pixels, as it was encoded. */
  readonly width: number;
  readonly height: number;
  /** When its view was asked for, on the page's clock. */
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
   * Keeps the picture that the video has now, and tells the number of its frame, which `numberAt` knows by its media time in seconds;
   * null if there is none. It may be newer than the frame that the browser has just told of: a picture must not be taken for another.
   */
  capture(numberAt: (mediaTime: number) => number | null): number | null {
    let picture: VideoFrame;
    try {
      picture = new VideoFrame(this.#video);
    } catch {
      return null; // a video that is on its way to another place has none
    }
    const frame = numberAt(picture.timestamp / 1e6);
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
