/**
 * Chooses JPEG or WebP for pictures. WebP has fewer bytes for the same picture but takes longer on the server and in
 * this browser, so it arrives earlier on slow links. Bytes and times are averaged per pixel and apply to any rung.
 * Pure.
 */
import type { FrameReply } from "#client/transport/transport";
import type { ServerConfig } from "#client/wire/render";

/** A WebP of one pixel, to test whether this browser decodes WebP like frames. */
const ONE_PIXEL = "UklGRiIAAABXRUJQVlA4IBYAAAAwAQCdASoBAAEADsD+JaQAA3AAAAAA";

export async function decodesWebp(): Promise<boolean> {
  const bytes = Uint8Array.from(atob(ONE_PIXEL), (character) => character.charCodeAt(0));
  try {
    (await createImageBitmap(new Blob([bytes], { type: "image/webp" }))).close();
    return true;
  } catch {
    return false;
  }
}

export type PictureFormat = NonNullable<ServerConfig["formats"]>[number];

/** Bytes of a WebP as a share of a JPEG's; docs/streams.md mostly measured larger savings. */
const SAVED = 0.2;
/** Extra encoding and decoding time of a million pixels in milliseconds, until measured. */
const LONGER = 22;
/** The part of it for decoding. */
const DECODING = 4;
/** Weight of the newest frame. */
const ALPHA = 0.2;
/** A format must be better by this factor to replace the other. */
const BETTER = 1.25;
/** The server's WebP time expires after this many milliseconds without one: the server may have been busy. */
const FORGOTTEN = 15_000;

export class FormatChoice {
  #last: PictureFormat = "jpeg";
  /** JPEG bytes per pixel; null until the first picture. */
  #bytes: number | null = null;
  #encoding = { ms: LONGER - DECODING, at: Number.NEGATIVE_INFINITY };

  observe({ header, arrival }: Pick<FrameReply, "header" | "arrival">, now: number): void {
    const megapixels = ((header.width ?? 0) * (header.height ?? 0)) / 1e6;
    if (megapixels === 0 || header.video) return; // a video frame says nothing about pictures
    const isWebp = header.content_type === "image/webp";
    const bytes = arrival.bytes / (isWebp ? 1 - SAVED : 1) / megapixels;
    this.#bytes = this.#bytes === null ? bytes : this.#bytes + ALPHA * (bytes - this.#bytes);
    if (!isWebp || !header.timing) return;
    const ms = header.timing.encode / megapixels;
    this.#encoding = { ms: this.#encoding.ms + ALPHA * (ms - this.#encoding.ms), at: now };
  }

  /** Format of the next picture on a link with this throughput in bits per second. */
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
