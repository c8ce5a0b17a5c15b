/**
 * The frames of the mode `video`, from answers to pictures. A picture is decoded once the one that it refers to was, so none is ever
 * shown whose chain is broken; what breaks it makes the next request ask for a key frame.
 */
import { computed, type ReadonlySignal, signal } from "@preact/signals";
import { type Deferred, deferred } from "../async/deferred";
import { type CalledWorker, WorkerCalls } from "../async/worker-calls";
import { FrameDropped, type FrameReply, type FrameTransport } from "../transport/transport";
import type { RenderRequest } from "../wire/render";
import { Chain, type Link } from "./chain";
import { type EncodedFrame, SKIPPED } from "./encoded-frame";

interface Arrived extends Link, Pick<EncodedFrame, "codec" | "image"> {
  readonly picture: Deferred<ImageBitmap>;
}

/** A picture as other decoders give it; a video has no depth. Whoever gets it closes its bitmap. */
export interface DecodedPicture {
  readonly bitmap: ImageBitmap;
  readonly depth: null;
}

/** A decoder that failed so many times in so many milliseconds is given up. */
const FAILURES = 4;
const SPAN = 10_000;
const UNCARRIED = "The mode Video needs WebTransport streams, and this connection has none. Choose another mode.";

export class VideoFrames {
  /** Why there can be no video, in a sentence for a person; null where there can. */
  readonly problem: ReadonlySignal<string | null> = computed(() => this.#undecodable.value ?? this.#uncarried.value);
  /** Key frames that came over the present transport. */
  keyFrames = 0;
  readonly #undecodable = signal<string | null>(null);
  readonly #uncarried = signal<string | null>(null);
  readonly #startWorker: () => CalledWorker;
  readonly #now: () => number;
  #worker: WorkerCalls<EncodedFrame, ImageBitmap> | undefined;
  #chain = new Chain<Arrived>();
  /** Requests under way, each of which is given up once no frame of the present transport is of use. */
  readonly #underWay = new Set<AbortController>();
  #number = 0;
  #failures: readonly number[] = [];

  constructor(startWorker: () => CalledWorker, now: () => number) {
    this.#startWorker = startWorker;
    this.#now = now;
  }

  /** The mode was chosen: `problem` says whether this browser can decode video. What failed before may work now. */
  async begin(problem: Promise<string | null>): Promise<void> {
    this.#failures = [];
    this.#undecodable.value = await problem;
  }

  /**
   * A transport whose requests for video ask for a key frame when one is needed, and are never cancelled: the server knows by itself
   * which are overtaken, and whatever it has encoded others refer to. From now on frames come over this one.
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

  /** No frame of before is of use: there is another connection, or none. */
  reset(): void {
    this.#drop(this.#chain.break());
    this.#chain = new Chain();
    for (const use of this.#underWay) use.abort(new FrameDropped("the viewer was closed"));
    this.keyFrames = 0;
  }

  /**
   * The picture of a frame of the video, once all that it refers to are decoded. To be called for each that comes, and at once: later
   * ones may refer to it. Rejects with FrameDropped if it cannot be decoded, and with the signal's reason if nobody wants it any more.
   */
  async decode({ header, image }: FrameReply, signal: AbortSignal): Promise<DecodedPicture> {
    const { video, seq } = header;
    if (!video) throw new Error("a frame of a video has its place in it");
    if (video.key) this.keyFrames++;
    const picture = deferred<ImageBitmap>();
    const frame = { seq, key: video.key, after: video.after ?? null, codec: video.codec, image, picture };
    const { ready, lost } = this.#chain.add(frame, this.#now());
    this.#drop(lost);
    for (const one of ready) void this.#feed(one, this.#chain);
    const bitmap = await picture.promise;
    if (signal.aborted) bitmap.close();
    signal.throwIfAborted();
    return { bitmap, depth: null };
  }

  /** Once per animation frame: waits no longer than `patience` for a frame that others refer to, in milliseconds. */
  tick(patience: number): void {
    this.#drop(this.#chain.expired(this.#now(), patience));
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

  /** What was handed over with the one that failed fails with it: that counts once. */
  #failed(chain: Chain<Arrived>, error: unknown): void {
    if (chain.broken || chain !== this.#chain) return;
    this.#drop(chain.break());
    const now = this.#now();
    this.#failures = [...this.#failures.filter((at) => now - at < SPAN), now];
    if (this.#failures.length < FAILURES) return;
    const why = error instanceof Error && error.message ? ` (${error.message.replace(/\.$/, "")})` : "";
    this.#undecodable.value = `This browser’s video decoder fails again and again${why}. Choose another mode.`;
  }

  #drop(frames: readonly Arrived[]): void {
    for (const { picture } of frames) picture.reject(new FrameDropped("a frame that it refers to is missing"));
  }
}
