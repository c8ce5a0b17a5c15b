/** The mode `webrtc`: a video call with the packager. */
import { streamed } from "./streamed";

export const WEBRTC = streamed({
  kind: "webrtc",
  settings: ["webrtcStream", "dashRepresentation"],
  load: async () => (await import("./webrtc-source")).openWebRtc,
});
