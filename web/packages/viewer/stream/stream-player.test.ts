import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { deferred } from "#client/async/deferred";
import { ApiError } from "#client/http/problem";
import type { PoseUpdate } from "#client/wire/dash";
import { STILL, steeredRig } from "#fakes/rig";
import type { Content, Reprojector, Turned } from "../reproject/reprojector";
import type { PresentedFrame } from "../view/presented";
import type { NumberedPose, Rig } from "../view/rig";
import { type OpenViews, StreamUnsupported, type ViewEvents, type ViewStream } from "./stream";
import { StreamPlayer } from "./stream-player";
import type { StreamedFrame } from "./turned-video";

const PLAYED: ViewStream["played"] = {
  webrtc: { codec: "VP8", rung: 2, width: 640, height: 360, frame_rate: 30, lost_packets: 0 },
};

/** The video's current media time in seconds. */
let mediaTimeNow: number;

class FakePicture {
  readonly timestamp = mediaTimeNow * 1e6;
  readonly displayWidth = 640;
  readonly displayHeight = 360;
  readonly close = () => undefined;
}

let now: number;
let video: HTMLVideoElement;
let axes: typeof STILL;
let rig: Rig;
let player: StreamPlayer;
let shown: PresentedFrame[];
/** Poses sent to the packager. */
let told: PoseUpdate[];
let tab: EventTarget & { hidden: boolean };
/** Callbacks of the last opened stream. */
let events: ViewEvents;
/** Streams that were ended. */
let disposed: number;
const openViews = vi.fn<OpenViews>();
/** The poses of pictures to warp, and the target poses. */
let turned: { taken: number[]; to: number[] };
/** Drawn but not reported. */
let drawn: Turned<StreamedFrame> | null;
let reprojector: Reprojector<StreamedFrame>;
/** Target latencies set on the stream. */
let aims: number[];
/** The browser presents a frame of the video. */
let present: (mediaTime: number, expectedDisplayTime: number) => void;

beforeEach(() => {
  vi.useFakeTimers();
  vi.spyOn(performance, "now").mockImplementation(() => now);
  tab = Object.assign(new EventTarget(), { hidden: false });
  vi.stubGlobal("document", tab);
  now = 0;
  axes = STILL;
  shown = [];
  told = [];
  aims = [];
  turned = { taken: [], to: [] };
  drawn = null;
  reprojector = {
    working: true,
    gpuMs: null,
    warpMs: () => 1,
    take: (_: VideoFrame, { pose, frame }: Content<StreamedFrame>) => {
      turned.taken.push(pose);
      drawn = { frame, pose, view: 0, filled: 0.1, warpMs: 1, fresh: true };
    },
    turn: ({ seq }: NumberedPose) => {
      turned.to.push(seq);
      if (drawn) drawn = { ...drawn, view: seq };
    },
    presented: () => {
      const told = drawn;
      if (drawn) drawn = null;
      return told;
    },
  } as unknown as Reprojector<StreamedFrame>;
  rig = steeredRig(() => axes);
  rig.resize(640, 360);
  rig.sample(0);
  vi.resetAllMocks();
  disposed = 0;
  openViews.mockImplementation(async (_, __, heard) => {
    events = heard;
    return stream();
  });
});

afterEach(() => {
  player.dispose();
  vi.useRealTimers();
});

/** A stream of 30 frames per second, in any player. */
function stream(): ViewStream {
  return {
    player: "a player",
    played: PLAYED,
    targetLatency: 120,
    latency: () => 0.1,
    aim: (target) => aims.push(target),
    status: async () => null,
    receiver: () => null,
    send: (pose) => told.push(pose) > 0,
    frame: (mediaTime) => Math.round(mediaTime * 30),
    rung: () => 2,
    dispose: () => {
      disposed++;
    },
  };
}

function open(overscan: number | null = null): void {
  video = {
    style: {},
    currentTime: 1.86,
    buffered: { length: 1, end: () => 2 },
    requestVideoFrameCallback: (heard: VideoFrameRequestCallback) => {
      present = (mediaTime, expectedDisplayTime) => {
        mediaTimeNow = mediaTime;
        heard(0, { mediaTime, expectedDisplayTime, width: 640, height: 360 } as VideoFrameCallbackMetadata);
      };
    },
  } as unknown as HTMLVideoElement;
  player = new StreamPlayer({
    video,
    rig,
    side: "dash",
    open: openViews,
    adaptive: true,
    prediction: () => "off",
    reprojector,
    overscan,
    onPresented: (frame) => shown.push(frame),
    onReceived: () => undefined,
  });
}

async function settle(): Promise<void> {
  await vi.advanceTimersByTimeAsync(0);
}

/** Runs an animation frame. */
function frame(at: number): void {
  now = at;
  player.tick(at, rig.sample(at));
}

test("latency is counted from the sample of a pose to the video frame that shows it, once the stream plays", async () => {
  open();
  await settle();
  axes = { ...STILL, forward: 1 };
  frame(100); // the stream does not play yet: waiting for it is not latency
  axes = STILL;
  events.told(0, rig.pose.seq);
  present(0, 1500);
  expect(player.phase.value.kind).toBe("playing");
  expect(player.played(0)).toEqual(PLAYED);
  axes = { ...STILL, forward: 1 };
  frame(1600);
  axes = STILL;
  events.told(4, rig.pose.seq);
  present(4 / 30, 1735);
  expect(player.stats.value.buffered).toBeCloseTo(140);
  expect(shown.map(({ at, latencies, rung }) => ({ at, latencies, rung }))).toEqual([
    { at: 1500, latencies: [], rung: 2 },
    { at: 1735, latencies: [135], rung: 2 },
  ]);
});

test("the packager hears of each new pose and of each new lens, and of neither twice", async () => {
  open();
  await settle();
  frame(16);
  frame(32);
  expect(told).toHaveLength(1);
  rig.lens.value = { fx: 900 };
  frame(48);
  expect(told.at(-1)?.fx).toBe(900);
  axes = { ...STILL, turnRight: 1 };
  frame(64);
  expect(told.map(({ seq }) => seq)).toEqual([rig.pose.seq - 1, rig.pose.seq - 1, rig.pose.seq]);
  axes = STILL;
  frame(80);
  rig.resize(320, 180); // the lens for the new viewport does not fit this stream
  frame(96);
  expect(told.at(-1)).toMatchObject({ fx: 900, cx: 320 });
});

test("with reprojection a stream is wider, its frames are turned, and view and content are told apart", async () => {
  vi.stubGlobal("VideoFrame", FakePicture);
  open(0.1);
  await settle();
  expect(openViews.mock.calls[0]?.[1]).toMatchObject({ width: 768, height: 432, cx: 384, cy: 216 });
  expect(video.style.scale).toBe("1.2"); // until one is turned, margins are outside the pane
  events.told(0, 0);
  present(0, 1500);
  const first = rig.pose.seq;
  axes = { ...STILL, turnRight: 1 };
  frame(1600);
  frame(1616);
  expect(shown).toEqual([]);
  player.presented(1633);
  expect(turned).toEqual({ taken: [first], to: [first + 1, first + 2] });
  expect(shown).toMatchObject([{ at: 1633, pose: first, view: first + 2, filled: 0.1, rung: 2, latencies: [33, 17] }]);
  expect(shown[0]).not.toHaveProperty("askedAt");
  player.presented(1650);
  expect(shown).toHaveLength(1);
  const message = told.at(-1)?.seq ?? -1;
  present(4 / 30, 1700); // before its pose is known
  expect(turned.taken).toEqual([first]);
  events.told(4, message);
  expect(turned.taken).toEqual([first, first + 2]);
});

test("what may pass is tried again, and a stream that ends is opened anew", async () => {
  openViews.mockRejectedValueOnce(new ApiError("4 sessions run already.", true));
  open();
  await settle();
  expect(player.phase.value).toEqual({ kind: "lost", message: "4 sessions run already." });
  await vi.advanceTimersByTimeAsync(1000);
  events.failed("The player stopped.");
  await settle();
  expect(player.phase.value).toEqual({ kind: "lost", message: "The player stopped." });
  expect(player.played(0)).toEqual({});
  expect(openViews).toHaveBeenCalledTimes(2); // not at once: it had never played
  await vi.advanceTimersByTimeAsync(3000);
  present(0, 10);
  await settle();
  events.failed("The stream was interrupted.");
  await settle();
  expect(openViews).toHaveBeenCalledTimes(4);
  expect(disposed).toBe(2);
});

test.each([
  [new ApiError("There is no scene “attic”.", false), "There is no scene “attic”."],
  [new StreamUnsupported("This browser cannot."), "This browser cannot."],
  [new TypeError("undefined is not a function"), "This browser cannot play the DASH stream."],
])("what will not pass is said, and not tried again", async (error, message) => {
  openViews.mockRejectedValue(error);
  open();
  await vi.advanceTimersByTimeAsync(10_000);
  expect(player.phase.value).toEqual({ kind: "failed", message });
  expect(openViews).toHaveBeenCalledTimes(1);
});

test("a stream that stalls is told to hold another latency, which is the player's from then on", async () => {
  const dash = {
    representations: [],
    frame_rate: 30,
    segment_s: 1,
    frames_per_chunk: 1,
    target_latency_ms: 120,
    player: "",
  };
  openViews.mockImplementation(async () => ({ ...stream(), played: { dash } }));
  open();
  await settle();
  frame(300);
  expect(player.stats.value.targetLatency).toBe(120);
  for (let at = 0; at < 4000; at += 100) present(at / 1000, at); // as expected
  present(4, 4100);
  expect(aims).toEqual([]);
  present(4.1, 4300);
  expect(aims).toEqual([170]);
  frame(5000);
  expect(player.stats.value).toMatchObject({ liveLatency: 100, targetLatency: 170 });
  const targets = (since: number) => player.played(since).dash?.targets_ms;
  expect([targets(0), targets(4000), targets(6000)]).toEqual([[120, 170], [120, 170], [170]]);
});

test("leaving ends the stream", async () => {
  open();
  await settle();
  player.dispose();
  expect(disposed).toBe(1);
});

test("a player that is left while it connects leaves no stream behind", async () => {
  const opening = deferred<ViewStream>();
  openViews.mockReturnValue(opening.promise);
  open();
  await settle();
  player.dispose();
  opening.resolve(stream());
  await settle();
  expect(disposed).toBe(1);
  expect(player.played(0)).toEqual({});
});
