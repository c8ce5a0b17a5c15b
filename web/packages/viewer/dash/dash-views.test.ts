import { beforeEach, expect, test, vi } from "vitest";
import type { FrameShown, SessionInfo } from "#client/wire/dash";
import type { Camera } from "../stream/camera-feed";
import { endSession, openSession } from "../stream/packager";
import { overDash } from "./dash-views";
import { playStream } from "./dashjs-stream";
import { openPoseSocket } from "./pose-socket";
import { type DashPlan, tuned } from "./presets";

vi.mock("../stream/packager");
vi.mock("./pose-socket");
vi.mock("./dashjs-stream", () => ({ playStream: vi.fn() })); // the real one loads a player that needs a browser

const SESSION = {
  id: "a",
  manifest: "/a.mpd",
  poses: "/a/poses",
  frame_rate: 30,
  target_latency_ms: 120,
  representations: [
    { id: "r2-4242", rung: 2, width: 640, height: 360, bitrate_kbps: 4242 },
    { id: "r3-1414", rung: 3, width: 320, height: 180, bitrate_kbps: 1414 },
  ],
} as unknown as SessionInfo;
const VIDEO = {} as HTMLVideoElement;
const events = { told: vi.fn(), received: vi.fn(), failed: vi.fn() };
const player = { player: "dash.js 5", latency: () => 0.1, aim: () => undefined, dispose: vi.fn() };
let announce: (frame: FrameShown) => void;
let hangUp: () => void;

beforeEach(() => {
  vi.resetAllMocks();
  vi.mocked(openSession).mockResolvedValue(SESSION);
  vi.mocked(openPoseSocket).mockImplementation((_, __, onFrame, onClose) => {
    announce = onFrame;
    hangUp = onClose;
    return { send: () => true, close: () => undefined };
  });
  vi.mocked(playStream).mockReturnValue(player);
});

function open(representation: DashPlan["representation"] = null, transport: DashPlan["transport"] = "tcp") {
  const plan: DashPlan = { setup: tuned(30), player: "dash.js", adaptive: true, representation, transport };
  const source = { base: "http://packager", h3: "https://render/services/dash", scene: "courtyard", plan };
  return overDash(source)(VIDEO, {} as Camera, events, new AbortController().signal);
}

test("the packager is asked for a single representation, or left to choose them", async () => {
  const representation = { rung: 3, bitrate_kbps: 500 };
  await open(representation);
  await open();
  const [single, several] = vi.mocked(openSession).mock.calls.map(([, request]) => request);
  expect(single?.representations).toEqual([representation]);
  expect(several).not.toHaveProperty("representations");
});

test("frames are told by their media time, rungs by their size, and records name the player", async () => {
  const stream = await open();
  expect(stream.frame(4 / 30 + 0.001, {} as VideoFrameCallbackMetadata)).toBe(4);
  expect([stream.rung(320, 180), stream.rung(1280, 720)]).toEqual([3, null]);
  const { frame_rate, target_latency_ms, representations } = SESSION;
  const played = { frame_rate, target_latency_ms, representations, player: "dash.js 5", protocols: [] };
  expect(stream.played).toEqual({ dash: played });
  announce({ frame: 4, media_time_s: 4 / 30, pose: 7 });
  expect(events.told).toHaveBeenCalledWith(4, 7);
});

test("a socket that closes interrupts the stream, and leaving ends it", async () => {
  const stream = await open();
  hangUp();
  expect(events.failed).toHaveBeenCalledWith("The DASH stream was interrupted.");
  stream.dispose();
  expect(player.dispose).toHaveBeenCalledOnce();
  expect(endSession).toHaveBeenCalledWith("http://packager", SESSION);
});

test("a stream that this browser cannot play is ended", async () => {
  vi.mocked(playStream).mockImplementation(() => {
    throw new TypeError("no player");
  });
  await expect(open()).rejects.toThrow("no player");
  expect(endSession).toHaveBeenCalledWith("http://packager", SESSION);
});

test("over HTTP/3 only the manifest, and so the segments, are elsewhere", async () => {
  const fetching = vi.spyOn(globalThis, "fetch").mockResolvedValue(new Response(""));
  await open(null, "h3");
  expect(fetching).toHaveBeenCalledWith("https://render/services/dash/time", expect.anything());
  expect(vi.mocked(playStream).mock.calls[0]?.[1]).toBe("https://render/services/dash/a.mpd");
  for (const api of [openSession, openPoseSocket]) expect(vi.mocked(api).mock.calls[0]?.[0]).toBe("http://packager");
});

test("a browser that does not reach HTTP/3 opens no stream, and one sentence says why", async () => {
  vi.spyOn(globalThis, "fetch").mockRejectedValue(new TypeError("Failed to fetch"));
  await expect(open(null, "h3")).rejects.toMatchObject({
    unreachable: false,
    message: "This browser cannot reach DASH over HTTP/3, or does not trust the server’s certificate.",
  });
  expect(openSession).not.toHaveBeenCalled();
});
