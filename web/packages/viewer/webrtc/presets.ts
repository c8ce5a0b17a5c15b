/** Encoding of a WebRTC stream by the packager's aiortc, with H.264 limited to 30 frames per second. */

export const WEBRTC_STREAMS = ["h264-30", "vp8-30", "vp8-60"] as const;
export type WebRtcStream = (typeof WEBRTC_STREAMS)[number];

export interface WebRtcPlan {
  /** Codec name as in its MIME type, after `video/`. */
  readonly codec: "H264" | "VP8";
  /** Frames per second. */
  readonly frameRate: 30 | 60;
}

/** Parameters of a new stream. */
export interface WebRtcSetup extends WebRtcPlan {
  /** The ladder's rung with the stream's size; null for the largest that fits into the viewport. */
  readonly rung: number | null;
  /** Largest bit rate; null for the browser's estimate of the link. */
  readonly bitrateKbps: number | null;
}

export const WEBRTC_PLANS: Readonly<Record<WebRtcStream, WebRtcPlan>> = {
  "h264-30": { codec: "H264", frameRate: 30 },
  "vp8-30": { codec: "VP8", frameRate: 30 },
  "vp8-60": { codec: "VP8", frameRate: 60 },
};

export const CODEC_NAMES: Readonly<Record<WebRtcPlan["codec"], string>> = { H264: "H.264", VP8: "VP8" };
