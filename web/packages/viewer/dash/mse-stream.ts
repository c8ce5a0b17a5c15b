/**
 * The bare player: plays a stream of one frame per chunk on Media Source Extensions with a nearly empty buffer. It has
 * half the latency of dash.js and few of its features: it reads only the manifests written by our packager.
 */
import { sleep } from "#client/async/retry";
import { type PlayStream, StreamEnded, type StreamEvents } from "../stream/stream";
import { type Manifest, readManifest } from "./manifest";
import { MediaBuffer } from "./media-buffer";
import { checkMediaSource } from "./media-source";
import { MARGIN, Pace, ServerClock } from "./pace";
import { fetched, SegmentFeed } from "./segment-feed";

/** Interval of adjusting the pace, in addition to doing so for each received chunk, in milliseconds. */
const LOOK_EVERY = 50;
/** Intervals of reading the server's clock, at the start and later, in milliseconds. */
const FIRST_LOOKS = 3;
const TIME_EVERY = 30_000;

export const playStream: PlayStream = (video, url, events) => {
  checkMediaSource(globalThis.MediaSource);
  const player = new MsePlayer(video, url, events);
  return {
    player: "bare MSE player",
    latency: () => player.latency,
    aim: (target) => player.aim(target),
    dispose: () => player.dispose(),
  };
};

class MsePlayer {
  readonly #video: HTMLVideoElement;
  readonly #events: StreamEvents;
  readonly #visit = new AbortController();
  readonly #clock = new ServerClock();
  readonly #pace = new Pace();
  #manifest: Manifest | undefined;
  #buffer: MediaBuffer | undefined;
  #started = false;
  /** Target latency in seconds; the manifest's until changed. */
  #target: number | undefined;

  constructor(video: HTMLVideoElement, url: string, events: StreamEvents) {
    this.#video = video;
    this.#events = events;
    void this.#play(url).catch((error: unknown) => {
      if (this.#visit.signal.aborted) return;
      const known = error instanceof StreamEnded;
      events.failed(known ? error.message : `The player stopped: ${error instanceof Error ? error.message : error}`);
    });
  }

  /** Latency behind the server's clock, in seconds; null before it plays. */
  get latency(): number | null {
    return this.#started ? this.#live() - this.#video.currentTime : null;
  }

  aim(target: number): void {
    this.#target = target / 1000;
  }

  dispose(): void {
    this.#visit.abort();
    this.#video.playbackRate = 1;
    this.#video.removeAttribute("src");
    this.#video.load();
  }

  async #play(url: string): Promise<void> {
    const { signal } = this.#visit;
    const manifest = readManifest(await (await fetched(url, signal)).text(), url);
    this.#manifest = manifest;
    this.#target ??= manifest.target / 1000;
    for (let look = 0; look < FIRST_LOOKS; look++) await this.#askTime(signal);
    void this.#keepTime(signal).catch(() => undefined); // it ends with the visit
    this.#buffer = await this.#open(manifest, signal);
    const buffer = this.#buffer;
    const looking = setInterval(() => this.#follow(), LOOK_EVERY);
    signal.addEventListener("abort", () => clearInterval(looking), { once: true });
    const feed = new SegmentFeed({
      manifest,
      live: () => this.#live(),
      onBytes: (bytes) => buffer.append(bytes),
      onInterrupted: () => buffer.interrupt(),
      onReceived: (bytes) => this.#events.received(bytes),
    });
    await feed.run(signal);
  }

  /** Opens a live source on the video element. */
  async #open({ representations }: Manifest, signal: AbortSignal): Promise<MediaBuffer> {
    const media = new MediaSource();
    const url = URL.createObjectURL(media);
    const opened = new Promise((resolve) => media.addEventListener("sourceopen", resolve, { once: true }));
    this.#video.src = url;
    this.#video.addEventListener("error", this.#broken, { signal });
    await opened;
    URL.revokeObjectURL(url);
    media.duration = Number.POSITIVE_INFINITY; // live: browsers then buffer as little as they can
    const { codecs } = representations.at(-1) ?? representations[0]; // a decoder of the best representation can decode them all
    return new MediaBuffer({
      source: media.addSourceBuffer(`video/mp4; codecs="${codecs}"`),
      signal,
      position: () => this.#video.currentTime,
      onAppended: () => this.#follow(),
      onFailed: (reason) => this.#events.failed(reason),
    });
  }

  readonly #broken = (): void => {
    this.#events.failed(`The player stopped: ${this.#video.error?.message || "the video cannot be decoded."}`);
  };

  /** Starts playback and keeps it at its target. */
  #follow(): void {
    const video = this.#video;
    const end = this.#buffer?.end ?? null;
    if (end === null || this.#target === undefined || video.seeking) return;
    if (!this.#started) {
      this.#started = true;
      video.currentTime = end - MARGIN;
      video.play().catch(() => undefined); // a page that leaves ends it
      return;
    }
    const next = this.#pace.next({ position: video.currentTime, end, live: this.#live(), target: this.#target });
    if ("jump" in next) video.currentTime = next.jump;
    else if (video.playbackRate !== next.rate) video.playbackRate = next.rate;
  }

  /** The server's position on the media timeline, in seconds. */
  #live(): number {
    return (this.#clock.at(now()) - (this.#manifest?.start ?? 0)) / 1000;
  }

  async #keepTime(signal: AbortSignal): Promise<void> {
    for (;;) {
      await sleep(TIME_EVERY, signal);
      await this.#askTime(signal).catch(() => undefined); // the stream itself reports the problem
    }
  }

  async #askTime(signal: AbortSignal): Promise<void> {
    const askedAt = now();
    const response = await fetched(this.#manifest?.timeUrl ?? "", signal);
    const heardAt = now();
    this.#clock.heard(Date.parse(await response.text()), askedAt, heardAt);
  }
}

const now = () => performance.now();
