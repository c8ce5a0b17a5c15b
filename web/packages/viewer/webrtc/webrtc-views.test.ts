import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import type { WebRtcSession } from "#client/wire/dash";
import type { Camera } from "../stream/camera-feed";
import { endSession, openWebRtc } from "../stream/packager";
import type { ViewStream } from "../stream/stream";
import { WEBRTC_PLANS } from "./presets";
import { overWebRtc } from "./webrtc-views";

vi.mock("../stream/packager");

const SESSION = { id: "a", sdp: "answer", codec: "H264", rung: 2, width: 640, height: 360, frame_rate: 30 };
const PLAN = { ...WEBRTC_PLANS["h264-30"], rung: 2, bitrateKbps: null };
const VIEW = { position: [0, 0, 0], quaternion: [0, 0, 0, 1], fx: 1, fy: 1, cx: 1, cy: 1, width: 640, height: 360 };

class FakeChannel extends EventTarget {
  readyState = "open";
  bufferedAmount = 0;
  sent: string[] = [];
  readonly options: RTCDataChannelInit;
  constructor(options: RTCDataChannelInit) {
    super();
    this.options = options;
  }
  send(text: string) {
    this.sent.push(text);
  }
}

class FakeConnection extends EventTarget {
  static last: FakeConnection;
  connectionState = "new";
  localDescription = { sdp: "offer" };
  closed = false;
  bytes = 0;
  readonly channels: Record<string, FakeChannel> = {};
  readonly receiver = { track: { stop: () => undefined }, jitterBufferTarget: null as number | null };
  readonly preferred: string[] = [];
  answer: unknown;
  constructor() {
    super();
    FakeConnection.last = this;
  }
  createDataChannel(label: string, options: RTCDataChannelInit) {
    const channel = new FakeChannel(options);
    this.channels[label] = channel;
    return channel;
  }
  addTransceiver() {
    const setCodecPreferences = (codecs: { mimeType: string }[]) =>
      void this.preferred.push(...codecs.map((codec) => codec.mimeType));
    return { receiver: this.receiver, setCodecPreferences };
  }
  getReceivers() {
    return [this.receiver];
  }
  async setLocalDescription() {}
  async setRemoteDescription(description: unknown) {
    this.answer = description;
  }
  async getStats() {
    return new Map([["v", { type: "inbound-rtp", kind: "video", bytesReceived: this.bytes }]]);
  }
  close() {
    this.closed = true;
  }
  become(state: string) {
    this.connectionState = state;
    this.dispatchEvent(new Event("connectionstatechange"));
  }
}

let heard: [frame: number, pose: number][];
let received: number[];
let failures: string[];
let codecs: string[];
const video = { srcObject: null as unknown, play: async () => undefined };

beforeEach(() => {
  vi.useFakeTimers();
  [heard, received, failures] = [[], [], []];
  codecs = ["video/VP8", "video/rtx", "video/H264", "video/AV1"];
  vi.mocked(openWebRtc).mockResolvedValue(SESSION as WebRtcSession);
  vi.mocked(endSession).mockReset().mockResolvedValue(undefined);
  vi.stubGlobal("RTCPeerConnection", FakeConnection);
  vi.stubGlobal("RTCRtpReceiver", {
    getCapabilities: () => ({ codecs: codecs.map((mimeType) => ({ mimeType })) }),
  });
  vi.stubGlobal("MediaStream", class {});
});

afterEach(() => {
  vi.useRealTimers();
});

function open(signal = new AbortController().signal): Promise<ViewStream> {
  const source = { base: "http://packager", scene: "courtyard", plan: PLAN };
  const events = {
    told: (frame: number, pose: number) => void heard.push([frame, pose]),
    received: (bytes: number) => void received.push(bytes),
    failed: (reason: string) => void failures.push(reason),
  };
  return overWebRtc(source)(video as unknown as HTMLVideoElement, VIEW as unknown as Camera, events, signal);
}

function tell(message: unknown): void {
  const event = new MessageEvent("message", { data: JSON.stringify(message) });
  FakeConnection.last.channels.frames?.dispatchEvent(event);
}

test("an offer of the chosen codec is answered, poses go out, and frames are named by their timestamps", async () => {
  const stream = await open();
  const { preferred, receiver, answer, channels } = FakeConnection.last;
  expect(preferred).toEqual(["video/H264", "video/rtx"]);
  expect(receiver.jitterBufferTarget).toBe(0);
  const [, asked] = vi.mocked(openWebRtc).mock.calls.at(-1) ?? [];
  expect(asked).toMatchObject({ scene: "courtyard", sdp: "offer", frame_rate: 30, rung: 2, bitrate_kbps: null });
  expect(answer).toEqual({ type: "answer", sdp: "answer" });
  expect(channels.poses?.options).toEqual({ ordered: false, maxRetransmits: 0 });
  expect(stream.send({ seq: 4, position: [0, 0, 0], quaternion: [0, 0, 0, 1] })).toBe(true);
  expect(JSON.parse(channels.poses?.sent[0] ?? "")).toMatchObject({ seq: 4 });
  if (channels.poses) channels.poses.bufferedAmount = 100;
  expect(stream.send({ seq: 5, position: [0, 0, 0], quaternion: [0, 0, 0, 1] })).toBe(false);
  tell({ rtp_timestamp: 2 ** 32 - 3000, pose: 4 });
  tell({ rtp_timestamp: 3000, pose: 5 });
  tell({ type: "tigas:invalid-request", detail: "It is wrong." });
  const presented = { mediaTime: 1.5, rtpTimestamp: 3000 } as VideoFrameCallbackMetadata;
  expect(heard).toEqual([
    [0, 4],
    [stream.frame(1.5, presented), 5],
  ]);
  expect(stream.frame(1.6, presented)).toBeNull();
});

test("a pose that was lost is sent again, until a frame shows it", async () => {
  const stream = await open();
  const sent = FakeConnection.last.channels.poses?.sent ?? [];
  const sequence = () => sent.map((text) => JSON.parse(text).seq);
  for (const seq of [6, 7]) stream.send({ seq, position: [0, 0, 0], quaternion: [0, 0, 0, 1] });
  tell({ rtp_timestamp: 3000, pose: 6 }); // it may be in flight
  expect(sequence()).toEqual([6, 7]);
  await vi.advanceTimersByTimeAsync(301);
  tell({ rtp_timestamp: 6000, pose: 6 });
  expect(sequence()).toEqual([6, 7, 7]);
  tell({ rtp_timestamp: 9000, pose: 6 });
  expect(sequence()).toEqual([6, 7, 7]);
  await vi.advanceTimersByTimeAsync(301);
  tell({ rtp_timestamp: 12000, pose: 7 });
  expect(sequence()).toEqual([6, 7, 7]);
});

test("bytes are those that came since they were last read", async () => {
  const stream = await open();
  for (const bytes of [1000, 2500]) {
    FakeConnection.last.bytes = bytes;
    await vi.advanceTimersByTimeAsync(250);
  }
  expect(received).toEqual([1000, 1500]);
  stream.dispose();
  await vi.advanceTimersByTimeAsync(1000);
  expect(received).toHaveLength(2);
});

test.each(["127.0.0.1", "::1"])(
  "a browser that does not connect to its own machine, %s, is told how it may",
  async (host) => {
    const sdp = `v=0\r\na=candidate:1 1 udp 2130706431 ${host} 8081 typ host\r\n`;
    vi.mocked(openWebRtc).mockResolvedValueOnce({ ...SESSION, sdp });
    await open();
    FakeConnection.last.become("failed");
    expect(failures).toEqual([expect.stringMatching(/^The server cannot be reached.* network address\.$/)]);
  },
);

test("a session is ended with its connection, and by that alone", async () => {
  (await open()).dispose();
  expect(FakeConnection.last.closed).toBe(false);
  await vi.advanceTimersByTimeAsync(0);
  expect(FakeConnection.last.closed).toBe(true);
  expect(endSession).toHaveBeenCalledExactlyOnceWith("http://packager", SESSION);
  expect([failures, video.srcObject]).toEqual([[], null]);
});

test("a packager that does not answer keeps no connection open", async () => {
  vi.mocked(endSession).mockReturnValue(new Promise(() => undefined));
  (await open()).dispose();
  await vi.advanceTimersByTimeAsync(250);
  expect(FakeConnection.last.closed).toBe(true);
});

test("a packager that is not reached, or no longer, is lost; a short silence is not", async () => {
  await open();
  await vi.advanceTimersByTimeAsync(10_000);
  expect(failures).toEqual(["The server cannot be reached over WebRTC: a firewall may block its UDP port."]);
  await open();
  const connection = FakeConnection.last;
  connection.become("connected");
  connection.become("disconnected");
  await vi.advanceTimersByTimeAsync(4000);
  connection.become("connected");
  await vi.advanceTimersByTimeAsync(20_000);
  expect(failures).toHaveLength(1);
  connection.become("disconnected");
  await vi.advanceTimersByTimeAsync(5000);
  connection.channels.frames?.dispatchEvent(new Event("close"));
  expect(failures.slice(1)).toEqual(["The WebRTC stream was interrupted.", "The WebRTC stream was interrupted."]);
});

test("a browser without WebRTC, or without the codec, says so; a refused offer leaves no connection", async () => {
  codecs = ["video/VP8"];
  await expect(open()).rejects.toThrow("This browser cannot decode H.264 over WebRTC; choose another codec.");
  expect(FakeConnection.last.closed).toBe(true);
  codecs = ["video/H264"];
  vi.mocked(openWebRtc).mockRejectedValueOnce(new ApiError("4 sessions run already.", true));
  await expect(open()).rejects.toThrow("4 sessions run already.");
  expect(FakeConnection.last.closed).toBe(true);
  vi.stubGlobal("RTCPeerConnection", undefined);
  await expect(open()).rejects.toThrow("This browser has no WebRTC, or it is turned off.");
});

test("a visit that ended while the stream was opened ends its session", async () => {
  const visit = new AbortController();
  vi.mocked(openWebRtc).mockImplementationOnce(async () => {
    visit.abort();
    return SESSION as WebRtcSession;
  });
  await expect(open(visit.signal)).rejects.toThrow();
  expect(endSession).toHaveBeenCalledOnce();
  expect(FakeConnection.last.closed).toBe(true);
});
