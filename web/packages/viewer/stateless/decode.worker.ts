/** Decodes frames off the main thread, and the depth that they carry. */
import { answerTo, type WorkerAnswer, type WorkerCall } from "#client/async/worker-calls";
import { decodeDepth } from "../reproject/decode-depth";
import type { DecodedImage } from "./decoder";

const scope = globalThis as unknown as {
  onmessage: ((event: MessageEvent<WorkerCall<Blob>>) => void) | null;
  postMessage(answer: WorkerAnswer<DecodedImage>, transfer: Transferable[]): void;
};

scope.onmessage = ({ data: { id, request } }) => {
  void answerTo(id, decode(request)).then((answer) =>
    scope.postMessage(answer, "value" in answer ? transferOf(answer.value) : []),
  );
};

async function decode(image: Blob): Promise<DecodedImage> {
  const [bitmap, depth] = await Promise.all([createImageBitmap(image), decodeDepth(image)]);
  return { bitmap, depth };
}

function transferOf({ bitmap, depth }: DecodedImage): Transferable[] {
  return depth === null ? [bitmap] : [bitmap, depth.codes.buffer];
}
