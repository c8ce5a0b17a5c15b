/** Stores samples off the main thread, one run at a time. */
import { answerTo, type WorkerAnswer, type WorkerCall } from "#client/async/worker-calls";
import { describe, SampleFiles } from "./sample-files";
import type { SampleRequest } from "./sample-writer";

const scope = globalThis as unknown as {
  onmessage: ((event: MessageEvent<WorkerCall<SampleRequest>>) => void) | null;
  postMessage(answer: WorkerAnswer<number>): void;
};

let files: SampleFiles | undefined;
/** Requests are processed in order. */
let before: Promise<unknown> = Promise.resolve();

scope.onmessage = ({ data: { id, request } }) => {
  const work = before.then(() => answer(request));
  before = work.catch(() => undefined);
  void answerTo(id, work).then((answered) => scope.postMessage(answered));
};

async function answer(request: SampleRequest): Promise<number> {
  switch (request.kind) {
    case "begin":
      files?.close();
      files = await SampleFiles.create(request.folder, request.about);
      return 0;
    case "keep":
      if (files === undefined) throw new Error("no run is being sampled");
      return files.keep(request.sample, request.jpeg, request.enhanced && (await encoded(request.enhanced)));
    case "describe":
      await describe(request.folder, request.about);
      return 0;
    case "end":
      files?.close();
      files = undefined;
      return 0;
  }
}

/** Encodes a picture losslessly, which not every browser's WebP is. */
async function encoded(picture: ImageBitmap): Promise<Blob> {
  const canvas = new OffscreenCanvas(picture.width, picture.height);
  canvas.getContext("2d", { alpha: false })?.drawImage(picture, 0, 0);
  picture.close();
  return canvas.convertToBlob({ type: "image/png" });
}
