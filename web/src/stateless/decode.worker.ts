/** Decodes frames off the main thread. */
import type { DecodeReply, DecodeRequest } from "./decoder";

const scope = globalThis as unknown as {
  onmessage: ((event: MessageEvent<DecodeRequest>) => void) | null;
  postMessage(reply: DecodeReply, transfer: Transferable[]): void;
};

scope.onmessage = ({ data: { id, image } }) => {
  createImageBitmap(image).then(
    (bitmap) => scope.postMessage({ id, bitmap }, [bitmap]),
    (error: unknown) => scope.postMessage({ id, error: String(error) }, []),
  );
};
