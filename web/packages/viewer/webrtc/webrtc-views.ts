/** A stream over WebRTC: the browser receives and decodes the video, and two data channels identify its frames. */

import { sleep } from "#client/async/retry";
import type { PoseUpdate, SentFrame, WebRtcRequest, WebRtcSession } from "#client/wire/dash";
import type { Camera } from "../stream/camera-feed";
import { endSession, openWebRtc, sessionStatus } from "../stream/packager";
import { type OpenViews, StreamUnsupported, type ViewEvents, type ViewStream } from "../stream/stream";
import { CODEC_NAMES, type WebRtcPlan, type WebRtcSetup } from "./presets";
import { type ReceiverStats, RtpFrames, StatsReader } from "./receiver-stats";

export interface WebRtcSource {
  /** URL of the packager. */
  readonly base: string;
  readonly scene: string;
  readonly plan: WebRtcSetup;
}

/** A stream that was left is closed after this long even if the packager does not answer, in milliseconds. */
const CLOSED_WITHIN = 250;
/** How long the packager may be unreachable before the stream is reopened, in milliseconds. */
const SILENT_FOR = 5000;
const CONNECTED_WITHIN = 10_000;
const STATS_EVERY = 250;
/** Time until an unanswered pose is sent again, in milliseconds. */
const REPEATED_AFTER = 300;
/** A candidate of the browser's own machine, to which Firefox does not connect. */
const LOOPBACK = /^a=candidate:.* (127\.[\d.]+|::1) \d+ typ host/m;
const INTERRUPTED = "The WebRTC stream was interrupted.";

export function overWebRtc(source: WebRtcSource): OpenViews {
  return async (video, view, events, signal) => {
    const connection = connect(source.plan);
    const poses = connection.createDataChannel("poses", { ordered: false, maxRetransmits: 0 });
    const frames = connection.createDataChannel("frames", { ordered: false });
    try {
      const session = await negotiated(connection, source, view, signal);
      return new WebRtcViews({ base: source.base, session, connection, poses, frames, video, events });
    } catch (error) {
      connection.close();
      throw error;
    }
  };
}

/** A connection that receives a video. Throws StreamUnsupported. */
function connect({ codec }: WebRtcPlan): RTCPeerConnection {
  const none = "This browser has no WebRTC, or it is turned off.";
  let connection: RTCPeerConnection;
  try {
    connection = new RTCPeerConnection({ bundlePolicy: "max-bundle" });
  } catch {
    throw new StreamUnsupported(none);
  }
  const { codecs } = RTCRtpReceiver.getCapabilities("video") ?? { codecs: [] };
  const wanted = codecs.filter(({ mimeType }) => mimeType === `video/${codec}`);
  if (wanted.length === 0) {
    connection.close();
    throw new StreamUnsupported(`This browser cannot decode ${CODEC_NAMES[codec]} over WebRTC; choose another codec.`);
  }
  const transceiver = connection.addTransceiver("video", { direction: "recvonly" });
  transceiver.setCodecPreferences([...wanted, ...codecs.filter(({ mimeType }) => mimeType === "video/rtx")]);
  showAtOnce(transceiver.receiver);
  return connection;
}

/** Makes frames wait as little as the browser allows before they are shown. */
function showAtOnce(receiver: RTCRtpReceiver): void {
  if ("jitterBufferTarget" in receiver) receiver.jitterBufferTarget = 0;
  else Object.assign(receiver, { playoutDelayHint: 0 }); // Chromium's name before standardisation
}

/**
 * Sends the offer and takes the answer. It waits for no candidates: the packager learns this page's address from its
 * packets.
 */
async function negotiated(
  connection: RTCPeerConnection,
  { base, scene, plan }: WebRtcSource,
  view: Camera,
  signal: AbortSignal,
): Promise<WebRtcSession> {
  await connection.setLocalDescription();
  const sdp = connection.localDescription?.sdp ?? "";
  const { frameRate: frame_rate, rung, bitrateKbps: bitrate_kbps } = plan;
  const request: WebRtcRequest = { scene, ...view, frame_rate, rung, bitrate_kbps, sdp };
  const session = await openWebRtc(base, request, signal);
  try {
    signal.throwIfAborted();
    await connection.setRemoteDescription({ type: "answer", sdp: session.sdp });
  } catch (error) {
    void endSession(base, session);
    if (signal.aborted) throw error;
    throw new StreamUnsupported("This browser does not accept the packager's WebRTC answer.");
  }
  return session;
}

interface Opened {
  readonly base: string;
  readonly session: WebRtcSession;
  readonly connection: RTCPeerConnection;
  readonly poses: RTCDataChannel;
  readonly frames: RTCDataChannel;
  readonly video: HTMLVideoElement;
  readonly events: ViewEvents;
}

class WebRtcViews implements ViewStream {
  readonly player = "WebRTC";
  readonly targetLatency = null;
  readonly #opened: Opened;
  readonly #numbers: RtpFrames;
  readonly #reader = new StatsReader();
  readonly #reading: ReturnType<typeof setInterval>;
  #silence: ReturnType<typeof setTimeout> | undefined;
  #stats: ReceiverStats | null = null;
  /** The last pose, and when it was sent. */
  #sent: { readonly pose: PoseUpdate; readonly at: number } | null = null;

  constructor(opened: Opened) {
    this.#opened = opened;
    const { connection, frames, video, session } = opened;
    this.#numbers = new RtpFrames(session.frame_rate);
    video.srcObject = new MediaStream(connection.getReceivers().map(({ track }) => track));
    void video.play().catch(() => undefined); // it has been removed meanwhile
    frames.addEventListener("message", this.#heard);
    frames.addEventListener("close", this.#interrupted);
    connection.addEventListener("connectionstatechange", this.#changed);
    this.#silence = setTimeout(() => this.#unreachable(), CONNECTED_WITHIN);
    this.#reading = setInterval(() => void this.#read(), STATS_EVERY);
  }

  get played(): ViewStream["played"] {
    const { codec, rung, width, height, frame_rate } = this.#opened.session;
    return { webrtc: { codec, rung, width, height, frame_rate, lost_packets: this.#stats?.lost ?? 0 } };
  }

  receiver(): ReturnType<ViewStream["receiver"]> {
    const codec = this.#opened.session.codec as WebRtcPlan["codec"];
    return { codec: CODEC_NAMES[codec], jitterBuffer: this.#stats?.jitterBuffer ?? null };
  }

  status(signal: AbortSignal): ReturnType<ViewStream["status"]> {
    return sessionStatus(this.#opened.base, this.#opened.session, signal);
  }

  latency(): null {
    return null;
  }

  aim(): void {}

  readonly send: ViewStream["send"] = (pose) => {
    const { poses } = this.#opened;
    if (poses.readyState !== "open" || poses.bufferedAmount > 0) return false;
    poses.send(JSON.stringify(pose));
    this.#sent = { pose, at: performance.now() };
    return true;
  };

  /** The browser reports the timestamp only for the presented frame. */
  frame(mediaTime: number, { mediaTime: presented, rtpTimestamp }: VideoFrameCallbackMetadata): number | null {
    const same = Math.abs(mediaTime - presented) < 0.001;
    return same && rtpTimestamp !== undefined ? this.#numbers.number(rtpTimestamp) : null;
  }

  rung(): number {
    return this.#opened.session.rung;
  }

  dispose(): void {
    const { base, session, connection, frames, video } = this.#opened;
    clearInterval(this.#reading);
    clearTimeout(this.#silence);
    frames.removeEventListener("close", this.#interrupted);
    connection.removeEventListener("connectionstatechange", this.#changed);
    video.srcObject = null;
    frames.removeEventListener("message", this.#heard);
    // Closing the connection also ends the session, so DELETE goes first; until then packets load the link.
    const closing = new AbortController();
    void Promise.race([endSession(base, session), sleep(CLOSED_WITHIN, closing.signal)]).finally(() => {
      closing.abort();
      connection.close();
    });
  }

  readonly #heard = ({ data }: MessageEvent<string>): void => {
    const message = JSON.parse(data) as SentFrame | { readonly type: string };
    if (!("pose" in message)) return;
    this.#opened.events.told(this.#numbers.number(message.rtp_timestamp), message.pose);
    // It was lost, and while the camera rests, no other follows.
    const sent = this.#sent;
    if (sent && message.pose < sent.pose.seq && performance.now() - sent.at > REPEATED_AFTER) this.send(sent.pose);
  };

  readonly #interrupted = (): void => this.#opened.events.failed(INTERRUPTED);

  readonly #changed = (): void => {
    const { connectionState } = this.#opened.connection;
    if (connectionState === "connected") clearTimeout(this.#silence);
    else if (connectionState === "failed") this.#unreachable();
    else if (connectionState === "disconnected") {
      clearTimeout(this.#silence);
      this.#silence = setTimeout(this.#interrupted, SILENT_FOR);
    }
  };

  #unreachable(): void {
    const here = LOOPBACK.test(this.#opened.session.sdp);
    const why = here
      ? "some browsers, such as Firefox, do not connect to their own machine. Open the page by its network address."
      : "a firewall may block its UDP port.";
    this.#opened.events.failed(`The server cannot be reached over WebRTC: ${why}`);
  }

  async #read(): Promise<void> {
    const stats = this.#reader.read((await this.#opened.connection.getStats()) as never);
    if (stats === null) return;
    this.#opened.events.received(stats.bytes - (this.#stats?.bytes ?? 0));
    this.#stats = stats;
  }
}
