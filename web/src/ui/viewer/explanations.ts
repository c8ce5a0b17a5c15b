/** What each figure of the page means, by its name (`data-stat`): shown where one points at it, and the main ones in the help. */

const PAST = "Median of the last seconds of movement.";

export const EXPLANATIONS = {
  "new-views": "Pictures of another pose than the one before: repeated and refined frames do not count.",
  "motion-to-photon": "From the moment that your input was read to the first frame on the screen that shows it.",
  "motion-to-photon-p95":
    "What 95 of 100 inputs of the last seconds of movement stay below. Inputs that still wait count as long as they have waited.",
  "view-latency": "From your input until the picture has turned with you, whatever the network.",
  "content-age": "How old the pixels are: from the pose that they were rendered for until you see them.",
  "round-trip": `From sending a request to the last byte of its frame. ${PAST}`,
  server: `Waiting, rendering and encoding, as the server measured them. ${PAST}`,
  "server-parts": "The server's time in its parts, in milliseconds.",
  throughput: "How fast the network delivered the last frames.",
  bandwidth: "What came in during the last two seconds.",
  received: "Bytes of pictures, segments or the scene's file since this side began.",
  buffered: "What has come of the stream and waits to be shown.",
  frame: "The size of the newest frame.",
  codec: "What the browser and the server agreed to encode the video with.",
  "jitter-buffer":
    "How long frames wait in the browser before they are decoded, so that late ones do not stop the video.",
  bitrate: "What the page asks the video to have.",
  "key-frames": "Frames of the video that need no other one, over this connection.",
  resolution: "Pixels of the newest frame, as it came.",
  profile: "The rung of the ladder that the newest frame has; refined ones have all pixels of the screen.",
  enhancement: "What restores and enlarges frames of this rung before they are shown.",
  "enhancement-time": "What the graphics processor takes to enhance a frame.",
  "reprojection-time":
    "What it takes to turn a picture to your newest pose: the page's main thread, and the graphics processor.",
  requests: "Requests that were sent and are not answered yet.",
  overtaken: "Requests that the page took back because of newer ones, and frames that came too late to be shown.",
  transport: "How requests and frames travel.",
  stalls: "How often, and for how long together, the picture stood still for more than 200 ms while you moved.",
  "live-latency": "How far the video that is played is behind what the packager makes.",
  "target-latency": "What the player aims at for that.",
  downloaded: "Of the scene's file.",
  gaussians: "How many of the scene's Gaussians are drawn.",
  "first-picture": "From the choice of this mode to the first picture.",
  complete: "From the choice of this mode until all of the scene was drawn.",
  renderer: "What this browser draws with.",
} as const satisfies Readonly<Record<string, string>>;

/** The name of a figure that says what it means. */
export type Explained = keyof typeof EXPLANATIONS;
