/** Network and decoding, off the page's main thread. */
import "../async/abort-any";
import { decodeDepth } from "./decode-depth";
import { FrameHost } from "./frame-host";
import type { FromWorker, ToWorker } from "./messages";

const scope = globalThis as unknown as {
  onmessage: ((event: MessageEvent<ToWorker>) => void) | null;
  postMessage(message: FromWorker, transfer: Transferable[]): void;
  close(): void;
};

const host = new FrameHost({
  post: (message, transfer) => scope.postMessage(message, transfer),
  decode: async (image) => {
    const [bitmap, depth] = await Promise.all([createImageBitmap(image), decodeDepth(image)]);
    return { bitmap, depth };
  },
});

scope.onmessage = ({ data }) => {
  host.receive(data);
  if (data.kind === "end") scope.close();
};
