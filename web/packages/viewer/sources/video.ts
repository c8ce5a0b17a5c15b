/** The mode `video`: one frame of a video per pose, decoded by WebCodecs. */
import { STATELESS } from "./pictures";
import type { SourceKind } from "./source";

/** Settings that do not apply to a video, which has neither depth nor other formats. */
const PICTURES_ONLY: readonly string[] = ["depth", "webp"];

export const VIDEO: SourceKind = {
  ...STATELESS,
  title: "Video",
  about: "One video frame for each camera pose, decoded by this browser.",
  settings: STATELESS.settings.filter((name) => !PICTURES_ONLY.includes(name)),
  load: async () => (await import("./video-source")).openVideo,
};
