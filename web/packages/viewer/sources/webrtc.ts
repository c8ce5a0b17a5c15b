/** The mode `webrtc`: a video call with the packager. */
import { WEBRTC_PLANS } from "../webrtc/presets";
import { overWebRtc } from "../webrtc/webrtc-views";
import { streamed } from "./streamed";

export const WEBRTC = streamed({
  kind: "webrtc",
  settings: ["webrtcStream", "dashRepresentation"],
  planOf: ({ webrtcStream, dashRepresentation, bitrateKbps }) => ({
    ...WEBRTC_PLANS[webrtcStream],
    rung: dashRepresentation?.rung ?? null,
    bitrateKbps: bitrateKbps ?? null,
  }),
  adaptive: () => false,
  open: overWebRtc,
});
