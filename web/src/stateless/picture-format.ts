/**
 * Whether pictures are asked for as JPEG or as WebP. WebP has fewer bytes for the same picture but takes the server, and this browser,
 * longer: it comes earlier where the link is slow. Bytes and times are counted for each pixel, so that any rung tells of all. Pure.
 */
import type { FrameReply } from "../transport/transport";
import type { ServerConfig } from "../wire/render";

export type PictureFormat = NonNullable<ServerConfig["formats"]>[number];

/** Of a JPEG's bytes; what docs/formats.md has measured is mostly more. */
const SAVED = 0.2;
/** How much longer a million pixels take, encoding and decoding, until the server has told; in milliseconds. */
const LONGER = 22;
/** Of that, decoding. */
const DECODING = 4;
/** Weight of the newest frame. */
const ALPHA = 0.2;
/** So many times better one has to be than the other, before it replaces that. */
const BETTER = 1.25;
/** What a WebP took the server is forgotten after so many milliseconds without one: it may have been busy. */
const FORGOTTEN = 15_000;

export class FormatChoice {
  #last: PictureFormat = "jpeg";
  /** Of a JPEG, for each pixel; null until a picture came. */
  #bytes: number | null = null;
  #encoding = { ms: LONGER - DECODING, at: Number.NEGATIVE_INFINITY };

  /** A picture came. */
  observe({ header, arrival }: Pick<FrameReply, "header" | "arrival">, now: number): void {
    const megapixels = ((header.width ?? 0) * (header.height ?? 0)) / 1e6;
    if (megapixels === 0 || header.video) return; // a video's frame tells nothing of pictures
    const isWebp = header.content_type === "image/webp";
    const bytes = arrival.bytes / (isWebp ? 1 - SAVED : 1) / megapixels;
    this.#bytes = this.#bytes === null ? bytes : this.#bytes + ALPHA * (bytes - this.#bytes);
    if (!isWebp || !header.timing) return;
    const ms = header.timing.encode / megapixels;
    this.#encoding = { ms: this.#encoding.ms + ALPHA * (ms - this.#encoding.ms), at: now };
  }

  /** For the next picture, on a link of so many bits per second. */
  next(throughput: number | null, now: number): PictureFormat {
    if (throughput === null || this.#bytes === null) return "jpeg";
    if (now - this.#encoding.at > FORGOTTEN) this.#encoding = { ms: LONGER - DECODING, at: now };
    const saved = (SAVED * this.#bytes * 8000) / throughput;
    const longer = this.#encoding.ms + DECODING;
    if (saved > longer * BETTER) this.#last = "webp";
    if (saved * BETTER < longer) this.#last = "jpeg";
    return this.#last;
  }
}
