/** The meaning of each figure by its name (`data-stat`), for tooltips and the help. */

const PAST = "Median over the last few seconds of movement.";

export const EXPLANATIONS = {
  "new-views": "Pictures per second that show a new camera pose; repeated and refined frames do not count.",
  "motion-to-photon": "Time from your input to the first frame on the screen that shows it.",
  "motion-to-photon-p95": "95th percentile over the last few seconds of movement, including input not shown yet.",
  "view-latency": "Time from your input until the picture turns; it does not depend on the network.",
  "content-age": "Age of the pixels: time from the pose they were rendered for until you see them.",
  "round-trip": `Time from sending a request to the last byte of its frame. ${PAST}`,
  server: `Time spent queueing, rendering and encoding, as measured by the server. ${PAST}`,
  "server-parts": "Breakdown of the server's time, in milliseconds.",
  throughput: "How fast the network delivered the latest frames.",
  bandwidth: "Average data rate over the last two seconds.",
  received: "Data received since this side started: pictures, segments or the scene's file.",
  buffered: "The part of the stream that has been received but not shown yet.",
  frame: "The size of the newest frame.",
  codec: "The video codec that the browser and the server agreed on.",
  "jitter-buffer": "How long frames wait in the browser before decoding, so that late ones do not interrupt the video.",
  bitrate: "Requested video bit rate.",
  "key-frames": "Key frames received on this connection.",
  resolution: "Size of the newest frame as received, in pixels.",
  profile: "The quality level of the newest frame; refined frames have the full resolution of the screen.",
  enhancement: "The models that restore and enlarge frames of this quality level.",
  "enhancement-time": "GPU time to enhance a frame.",
  "reprojection-time": "Time to turn a picture to your latest pose: on the main thread and on the GPU.",
  requests: "Requests waiting for an answer.",
  overtaken: "Requests cancelled in favour of newer ones, and frames that arrived too late to be shown.",
  transport: "How requests and frames are sent.",
  stalls: "How often, and for how long in total, the picture froze for more than 200 ms while you moved.",
  "live-latency": "How far playback is behind the live edge.",
  "target-latency": "Live latency the player is aiming for.",
  downloaded: "How much of the scene's file has been downloaded.",
  gaussians: "How many of the scene's Gaussians are drawn.",
  "first-picture": "Time from choosing this mode to the first picture.",
  complete: "Time from choosing this mode until the whole scene is drawn.",
  renderer: "The graphics API that this browser draws with.",
} as const satisfies Readonly<Record<string, string>>;

export type Explained = keyof typeof EXPLANATIONS;
