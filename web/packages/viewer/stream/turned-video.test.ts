import { beforeEach, expect, test, vi } from "vitest";
import type { Content, Reprojector } from "../reproject/reprojector";
import type { Told } from "./camera-feed";
import { type StreamedFrame, TurnedVideo } from "./turned-video";

/** The video's current picture: the time of its frame, in seconds; null while it seeks. */
let mediaTime: number | null;
let pictures: FakePicture[];
let taken: [picture: unknown, content: Content<StreamedFrame>][];
let subject: TurnedVideo;
let video: { currentTime: number };
const at30 = (time: number) => Math.round(time * 30);

class FakePicture {
  readonly timestamp = Math.round((mediaTime ?? 0) * 1e6);
  readonly displayWidth = 384;
  readonly displayHeight = 216;
  open = true;
  constructor() {
    if (mediaTime === null) throw new DOMException("", "InvalidStateError");
    pictures.push(this);
  }
  close(): void {
    this.open = false;
  }
}

beforeEach(() => {
  pictures = [];
  video = { currentTime: 1.5 };
  taken = [];
  vi.stubGlobal("VideoFrame", FakePicture);
  const reprojector = {
    take: (picture: FakePicture, content: Content<StreamedFrame>) => {
      expect(picture.open).toBe(true);
      taken.push([picture, content]);
    },
  };
  subject = new TurnedVideo(video as HTMLVideoElement, reprojector as unknown as Reprojector<StreamedFrame>);
});

const ABOUT = { rung: 2, width: 384, height: 216 };

function told(pose: number): Told {
  const camera = { position: [0, 0, pose], quaternion: [0, 0, 0, 1] } as const;
  const asked = { ...camera, fx: 600, fy: 600, cx: 320, cy: 180, width: 640, height: 360 };
  return { pose, at: 50, asked, view: { ...asked, cx: 384, cy: 216, width: 768, height: 432 } } as unknown as Told;
}

test("a picture goes to the canvas with the view that it shows, in its own pixels, and is given back", () => {
  mediaTime = 2.033333;
  expect(subject.capture(0, at30)).toBe(61);
  subject.show(61, told(7), ABOUT);
  expect(taken).toEqual([
    [
      pictures[0],
      {
        frame: { ...ABOUT, askedAt: 50 },
        pose: 7,
        asked: told(7).asked,
        view: { ...told(7).view, fx: 300, fy: 300, cx: 192, cy: 108, width: 384, height: 216 },
        depth: null,
      },
    ],
  ]);
  expect(pictures[0]?.open).toBe(false);
});

function capture(frame: number): void {
  mediaTime = frame / 30;
  subject.capture(0, at30);
}

test("a picture that waits for its view is shown once, not with another's, and not after a newer one", () => {
  for (const frame of [60, 61, 62]) capture(frame);
  expect(taken).toEqual([]);
  for (const frame of [61, 61, 60, 62]) subject.show(frame, told(frame), ABOUT);
  expect(taken.map(([picture, { pose }]) => [picture, pose])).toEqual([
    [pictures[1], 61],
    [pictures[2], 62],
  ]);
  expect(pictures.some(({ open }) => open)).toBe(false);
});

test("a video that seeks has no picture, and a stream that ends leaves none behind", () => {
  mediaTime = null;
  expect(subject.capture(0, at30)).toBeNull();
  mediaTime = 1;
  subject.capture(0, at30);
  subject.clear();
  expect(pictures.map(({ open }) => open)).toEqual([false]);
});

test("a picture of which nobody can say what it shows is given back at once", () => {
  mediaTime = 1;
  expect(subject.capture(0, () => null)).toBeNull();
  expect(pictures.map(({ open }) => open)).toEqual([false]);
});

test("a picture without a time of its own, as Firefox gives it, is the frame that was reported", () => {
  video.currentTime = 2.05;
  mediaTime = 2e-6;
  expect(subject.capture(2.033333, at30)).toBe(61);
  mediaTime = 2.066666;
  expect(subject.capture(2.033333, at30)).toBe(62);
});

test("of frames that nobody tells of only the newest wait", () => {
  for (let frame = 30; frame < 35; frame++) capture(frame);
  expect(pictures.map(({ open }) => open)).toEqual([false, false, true, true, true]);
});
