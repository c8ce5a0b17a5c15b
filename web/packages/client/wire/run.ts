// Generated from services/experiments/tigas_experiments/wire/run.py by `npm run wire`. Do not edit.

export const PER_VIEW = ["stateless", "video"] as const;
export const DASH = ["dash-typical", "dash-tuned", "dash-edge"] as const;
export const LOCAL = ["local-ply", "local-compressed", "local-streamed"] as const;
export const MODE_NAMES = {
  stateless: "Stateless",
  video: "Video",
  "dash-typical": "DASH, typical",
  "dash-tuned": "DASH, tuned",
  "dash-edge": "DASH, edge",
  webrtc: "WebRTC",
  "local-ply": "Local, PLY",
  "local-compressed": "Local, compressed",
  "local-streamed": "Local, streamed",
} as const;
export const MODES = [
  "stateless",
  "video",
  "dash-typical",
  "dash-tuned",
  "dash-edge",
  "webrtc",
  "local-compressed",
  "local-streamed",
] as const;
export const DASH_TRANSPORTS = { tcp: "TCP", h3: "HTTP/3" } as const;
export const UNSHAPED = "unshaped";
export const SOURCES = ["stateless", "video", "dash", "webrtc", "local"] as const;
export const SIDE_MODES = [
  "stateless",
  "video",
  "dash-typical",
  "dash-tuned",
  "dash-edge",
  "dash-custom",
  "webrtc",
  "local",
] as const;
export const USUAL_SIDES = ["stateless", "dash-tuned"] as const;
export const LINK_TERMS = [
  { field: "down_kbps", unit: "mbit", scale: 1000, usual: null },
  { field: "up_kbps", unit: "mbit-up", scale: 1000, usual: 10000 },
  { field: "jitter_ms", unit: "ms-jitter", scale: 1, usual: 0 },
  { field: "loss_pct", unit: "%-loss", scale: 1, usual: 0 },
  { field: "delay_ms", unit: "ms-rtt", scale: 0.5, usual: 0 },
] as const;
