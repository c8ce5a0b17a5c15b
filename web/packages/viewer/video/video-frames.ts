/**
 * Decodes the frames of the mode `video`. A picture is decoded after its reference, so a broken chain is never shown;
 * it makes the next request ask for a key frame.
 */
import { computed, type ReadonlySignal, signal } from "@preact/signals";
import { type Deferred, deferred } from "#client/async/deferred";
import { type CalledWorker, WorkerCalls } from "#client/async/worker-calls";
import { FrameDropped, type FrameReply, type FrameTransport } from "#client/transport/transport";
import type { RenderRequest } from "#client/wire/render";
import { Chain, type Link } from "./chain";
import { type EncodedFrame, SKIPPED } from "./encoded-frame";

/** The server's main profile; level 3.1 includes the paper's best rung. */
const CODEC = "avc1.4d001f";

/** Why this browser cannot decode video, in a sentence for the user; null if it can. */
export async function videoProblem(): Promise<string | null> {
  if (typeof VideoDecoder === "undefined") {
    const why = isSecureContext ? "This browser has no WebCodecs" : "Browsers decode single frames only over HTTPS";
    return `${why}, which the Video mode needs. Choose another mode.`;
  }
  const { supported } = await VideoDecoder.isConfigSupported({ codec: CODEC, optimizeForLatency: true }).catch(() => ({
    supported: false,
  }));
  return supported ? null : "This browser cannot decode H.264, which the Video mode needs. Choose another mode.";
}

interface Arrived extends Link, Pick<EncodedFrame, "codec" | "image"> {
  readonly picture: Deferred<ImageBitmap>;
}

/** A picture in the form of other decoders, without depth. The recipient closes its bitmap. */
export interface DecodedPicture {
  readonly bitmap: ImageBitmap;
  readonly depth: null;
}

/** A decoder is abandoned after this many failures within this many milliseconds. */
const FAILURES = 4;
const SPAN = 10_000;
const UNCARRIED = "The Video mode needs WebTransport, which this connection does not have. Choose another mode.";

export class VideoFrames {
  /** Why video is impossible, in a sentence for the user; null if it is possible. */
  readonly problem: ReadonlySignal<string | null> = computed(() => this.#undecodable.value ?? this.#uncarried.value);
  /** Key frames received over the current transport. */
  keyFrames = 0;
  readonly #undecodable = signal<string | null>(null);
  readonly #uncarried = signal<string | null>(null);
  readonly #startWorker: () => CalledWorker;
  #worker: WorkerCalls<EncodedFrame, ImageBitmap> | undefined;
  #chain = new Chain<Arrived>();
  /** Requests in flight, each aborted once frames of the current transport are useless. */
  readonly #underWay = new Set<AbortController>();
  #number = 0;
  #failures: readonly number[] = [];

  /** `problem` tells whether this browser can decode video. */
  constructor(startWorker: () => CalledWorker, problem: Promise<string | null>) {
    this.#startWorker = startWorker;
    void problem.then((sentence) => {
      this.#undecodable.value ??= sentence;
    });
  }

  /**
   * A transport for video: it asks for a key frame when needed and never cancels a request, because the server drops
   * outdated requests itself and later frames refer to all encoded ones. It becomes the source of all further frames.
   */
  over(transport: FrameTransport): FrameTransport {
    this.reset();
    this.#uncarried.value = transport.kind === "webtransport-streams" ? null : UNCARRIED;
    const chain = this.#chain;
    return {
      kind: transport.kind,
      maxInFlight: transport.maxInFlight,
      overtaking: transport.overtaking,
      lost: transport.lost,
      close: () => transport.close(),
      request: async (request, signal) => {
        const { video, seq = 0 } = request;
        if (!video) return transport.request(request, signal);
        const asking: RenderRequest = chain.asks(seq) ? { ...request, video: { ...video, key: true } } : request;
        const use = new AbortController();
        this.#underWay.add(use);
        try {
          return await transport.request(asking, use.signal);
        } catch (error) {
          this.#drop(chain.ended(seq));
          throw error;
        } finally {
          this.#underWay.delete(use);
        }
      },
    };
  }

  /** Discards all frames, for a new connection or none. */
  reset(): void {
    this.#drop(this.#chain.break());
    this.#chain = new Chain();
    for (const use of this.#underWay) use.abort(new FrameDropped("the viewer was closed"));
    this.keyFrames = 0;
  }

  /**
   * The picture of a frame, once its references are decoded. Must be called for each frame on arrival, because later
   * ones may refer to it. Rejects with FrameDropped if it cannot be decoded, with the signal's reason if aborted.
   */
  async decode({ header, image }: FrameReply, signal: AbortSignal): Promise<DecodedPicture> {
    const { video, seq } = header;
    if (!video) throw new Error("a video frame needs its place in the video");
    if (video.key) this.keyFrames++;
    const picture = deferred<ImageBitmap>();
    const frame = { seq, key: video.key, after: video.after ?? null, codec: video.codec, image, picture };
    const { ready, lost } = this.#chain.add(frame, performance.now());
    this.#drop(lost);
    for (const one of ready) void this.#feed(one, this.#chain);
    const bitmap = await picture.promise;
    if (signal.aborted) bitmap.close();
    signal.throwIfAborted();
    return { bitmap, depth: null };
  }

  /** Once per animation frame: waits no longer than `patience` for a frame that others refer to, in milliseconds. */
  tick(patience: number): void {
    this.#drop(this.#chain.expired(performance.now(), patience));
  }

  dispose(): void {
    this.reset();
    this.#worker?.dispose();
    this.#worker = undefined;
  }

  async #feed({ key, codec, image, picture }: Arrived, chain: Chain<Arrived>): Promise<void> {
    this.#worker ??= new WorkerCalls(this.#startWorker(), (bitmap: ImageBitmap) => bitmap.close());
    try {
      picture.resolve(await this.#worker.call({ number: this.#number++, key, codec, image }));
    } catch (error) {
      picture.reject(new FrameDropped("the video decoder gave no picture"));
      if (!(error instanceof Error && error.name === SKIPPED)) this.#failed(chain, error);
    }
  }

  /** Frames queued together with a failed one fail as well; that counts once. */
  #failed(chain: Chain<Arrived>, error: unknown): void {
    if (chain.broken || chain !== this.#chain) return;
    this.#drop(chain.break());
    const now = performance.now();
    this.#failures = [...this.#failures.filter((at) => now - at < SPAN), now];
    if (this.#failures.length < FAILURES) return;
    const why = error instanceof Error && error.message ? ` (${error.message.replace(/\.$/, "")})` : "";
    this.#undecodable.value = `This browser’s video decoder keeps failing${why}. Choose another mode.`;
  }

  #drop(frames: readonly Arrived[]): void {
    for (const { picture } of frames) picture.reject(new FrameDropped("a frame that it refers to is missing"));
  }
}
