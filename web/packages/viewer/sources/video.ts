/** The mode `video`: one frame of a video per pose, decoded by WebCodecs. */
import { videoProblem } from "../video/support";
import { VideoFrames } from "../video/video-frames";
import { Pictures, STATELESS } from "./pictures";
import type { SourceKind } from "./source";

/** A video has neither a depth nor another format. */
const PICTURES_ONLY: readonly string[] = ["depth", "webp"];

export const VIDEO: SourceKind = {
  ...STATELESS,
  title: "Video",
  settings: STATELESS.settings.filter((name) => !PICTURES_ONLY.includes(name)),
  open: (context) => {
    const worker = () =>
      new Worker(new URL("../video/video.worker.ts", import.meta.url), { type: "module", name: "video decoder" });
    return new Pictures(context, new VideoFrames(worker, context.now, videoProblem()));
  },
};
