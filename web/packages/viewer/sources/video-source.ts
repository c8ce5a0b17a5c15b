/** Frames of a video as a source. */
import { VideoFrames, videoProblem } from "../video/video-frames";
import { Pictures } from "./pictures";
import type { OpenSource } from "./source";

export const openVideo: OpenSource = (context) => {
  const worker = () =>
    new Worker(new URL("../video/video.worker.ts", import.meta.url), { type: "module", name: "video decoder" });
  return new Pictures(context, new VideoFrames(worker, videoProblem()));
};
