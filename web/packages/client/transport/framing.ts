/** The bytes of a frame on WebTransport: the header's length, the header, the image or a problem. */
import type { FrameHeader, Problem } from "../wire/render";
import { RequestProblem } from "./transport";

type Bytes = Uint8Array<ArrayBuffer>;

const LENGTH_BYTES = 4;
const MAX_HEADER_BYTES = 65_536;

/** The header and the image of a reply. Throws RequestProblem if the server refused, Error if the bytes are invalid. */
export function parseFrame(chunks: readonly Bytes[]): { header: FrameHeader; image: Blob } {
  const length = split(chunks, LENGTH_BYTES);
  const headerBytes = new DataView(length.head.buffer, length.head.byteOffset).getUint32(0);
  if (headerBytes > MAX_HEADER_BYTES) throw new Error(`a header of ${headerBytes} bytes is no header`);
  const { head, tail } = split(length.tail, headerBytes);
  const header = JSON.parse(new TextDecoder().decode(head)) as FrameHeader;
  if (!Number.isInteger(header?.status) || !Number.isInteger(header.seq)) {
    throw new Error("a frame's header has no status or no number");
  }
  if (header.status >= 400) throw new RequestProblem(JSON.parse(new TextDecoder().decode(join(tail))) as Problem);
  return { header, image: new Blob(tail as Bytes[], { type: header.content_type }) };
}

/** The first `count` bytes in one piece, and the remaining chunks. */
function split(chunks: readonly Bytes[], count: number): { head: Bytes; tail: readonly Bytes[] } {
  let end = 0;
  let seen = 0;
  while (seen < count) {
    const chunk = chunks[end++];
    if (chunk === undefined) throw new Error(`a frame ended after ${seen} of ${count} bytes`);
    seen += chunk.byteLength;
  }
  const bytes = join(chunks.slice(0, end));
  return { head: bytes.subarray(0, count), tail: [bytes.subarray(count), ...chunks.slice(end)] };
}

function join(chunks: readonly Bytes[]): Bytes {
  const [only] = chunks;
  if (only !== undefined && chunks.length === 1) return only;
  const bytes = new Uint8Array(chunks.reduce((sum, chunk) => sum + chunk.byteLength, 0));
  let offset = 0;
  for (const chunk of chunks) {
    bytes.set(chunk, offset);
    offset += chunk.byteLength;
  }
  return bytes;
}
