/** Media Source Extensions of this browser, which play DASH. */
import { StreamUnsupported } from "../stream/stream";

/** Baseline profile: a browser with H.264 plays it. */
const H264 = 'video/mp4; codecs="avc1.42E01E"';

/** Checks that a stream can be played with these extensions; undefined: the browser has none. */
export function checkMediaSource(extensions: Pick<typeof MediaSource, "isTypeSupported"> | undefined): void {
  if (extensions === undefined) {
    throw new StreamUnsupported("This browser cannot play DASH streams: it has no Media Source Extensions.");
  }
  if (!extensions.isTypeSupported(H264)) {
    throw new StreamUnsupported("This browser cannot play DASH streams: it has no H.264 decoder.");
  }
}
