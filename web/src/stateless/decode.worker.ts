/** Decodes frames off the main thread. */
import { answerTo, type WorkerAnswer, type WorkerCall } from "../async/worker-calls";

const scope = globalThis as unknown as {
  onmessage: ((event: MessageEvent<WorkerCall<Blob>>) => void) | null;
  postMessage(answer: WorkerAnswer<ImageBitmap>, transfer: Transferable[]): void;
};

scope.onmessage = ({ data: { id, request } }) => {
  void answerTo(id, createImageBitmap(request)).then((answer) =>
    scope.postMessage(answer, "value" in answer ? [answer.value] : []),
  );
};
