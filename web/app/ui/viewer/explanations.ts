/** The meaning of each figure by its name (`data-stat`), for tooltips and the help. */

const PAST = "Median of the last seconds of movement.";

export const EXPLANATIONS = {
  "new-views": "Pictures of another pose than the one before, per second; repeated and refined frames do not count.",
  "motion-to-photon": "From reading your input to the first frame on the screen that shows it.",
  "motion-to-photon-p95": "95th percentile over the last seconds of movement, including inputs not yet shown.",
  "view-latency": "From your input until the picture has turned, which does not depend on the network.",
  "content-age": "How old the pixels are: from the pose they were rendered for until you see them.",
  "round-trip": `From sending a request to the last byte of its frame. ${PAST}`,
  server: `Waiting, rendering and encoding, as the server measured them. ${PAST}`,
  "server-parts": "The parts of the server's time, in milliseconds.",
  throughput: "How fast the network delivered the latest frames.",
  bandwidth: "Received during the last two seconds.",
  received: "Bytes of pictures, segments or the scene's file since this side started.",
  buffered: "The part of the stream that was received and waits to be shown.",
  frame: "The size of the newest frame.",
  codec: "The video codec that browser and server agreed on.",
  "jitter-buffer":
    "How long frames wait in the browser before they are decoded, so that late ones do not stop the video.",
  bitrate: "Requested video bit rate.",
  "key-frames": "Key frames received on this connection.",
  resolution: "Pixels of the newest frame as received.",
  profile: "The quality level of the newest frame; refined frames have all pixels of the screen.",
  enhancement: "The models that restore and enlarge frames of this quality level.",
  "enhancement-time": "The graphics processor's time to enhance a frame.",
  "reprojection-time": "Time to turn a picture to your newest pose: main thread and graphics processor.",
  requests: "Requests that are not answered yet.",
  overtaken: "Requests cancelled in favour of newer ones, and frames that came too late to be shown.",
  transport: "How requests and frames travel.",
  stalls: "How often, and for how long in total, the picture froze for more than 200 ms while you moved.",
  "live-latency": "How far playback is behind the packager.",
  "target-latency": "Live latency the player is aiming for.",
  downloaded: "The part of the scene's file that was downloaded.",
  gaussians: "Gaussians of the scene that are drawn.",
  "first-picture": "From choosing this mode to the first picture.",
  complete: "From choosing this mode until the whole scene is drawn.",
  renderer: "The graphics interface this browser draws with.",
} as const satisfies Readonly<Record<string, string>>;

export type Explained = keyof typeof EXPLANATIONS;
