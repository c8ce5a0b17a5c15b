/** A stream over WebRTC as a source. */
import { WEBRTC_PLANS } from "../webrtc/presets";
import { overWebRtc } from "../webrtc/webrtc-views";
import { openStreamed } from "./streamed-source";

export const openWebRtc = openStreamed({
  kind: "webrtc",
  planOf: ({ webrtcStream, dashRepresentation, bitrateKbps }) => ({
    ...WEBRTC_PLANS[webrtcStream],
    rung: dashRepresentation?.rung ?? null,
    bitrateKbps: bitrateKbps ?? null,
  }),
  adaptive: () => false,
  open: overWebRtc,
});
