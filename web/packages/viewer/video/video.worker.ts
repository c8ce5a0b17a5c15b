/** Decodes a video's frames off the main thread, in the order in which they are handed over. */
import { type Deferred, deferred } from "#client/async/deferred";
import { answerTo, type WorkerAnswer, type WorkerCall } from "#client/async/worker-calls";
import { type EncodedFrame, SKIPPED } from "./encoded-frame";

const scope = globalThis as unknown as {
  onmessage: ((event: MessageEvent<WorkerCall<EncodedFrame>>) => void) | null;
  postMessage(answer: WorkerAnswer<ImageBitmap>, transfer: Transferable[]): void;
};

let decoder: VideoDecoder | null = null;
let configured = "";
/** Awaited pictures by the number of the frame, in order. */
const awaited = new Map<number, Deferred<ImageBitmap>>();
/** Chains the reading of frames' bytes, which takes a moment, so that they do not overtake each other. */
let fed: Promise<void> = Promise.resolve();

scope.onmessage = ({ data: { id, request } }) => {
  const picture = deferred<ImageBitmap>();
  fed = fed.then(() => feed(request, picture)).catch((error: unknown) => picture.reject(error));
  void answerTo(id, picture.promise).then((answer) =>
    scope.postMessage(answer, "value" in answer ? [answer.value] : []),
  );
};

async function feed({ number, key, codec, image }: EncodedFrame, picture: Deferred<ImageBitmap>): Promise<void> {
  const data = await image.arrayBuffer();
  if (decoder === null || (key && codec !== configured)) {
    decoder?.close();
    fail(new Error("another decoder takes over"));
    decoder = new VideoDecoder({ output: take, error: fail });
    // Without `description`: parameter sets are in band (Annex B).
    decoder.configure({ codec, optimizeForLatency: true });
    configured = codec;
  }
  awaited.set(number, picture);
  try {
    decoder.decode(new EncodedVideoChunk({ type: key ? "key" : "delta", timestamp: number, data }));
  } catch (error) {
    awaited.delete(number);
    throw error;
  }
}

/** Takes a decoded picture; missing pictures before it will not follow. */
function take(frame: VideoFrame): void {
  let wanted: Deferred<ImageBitmap> | undefined;
  for (const [number, picture] of awaited) {
    if (number > frame.timestamp) break;
    awaited.delete(number);
    if (number === frame.timestamp) wanted = picture;
    else picture.reject(Object.assign(new Error("the decoder has left a frame out"), { name: SKIPPED }));
  }
  if (wanted) void convert(frame, wanted);
  else frame.close(); // a decoder lends only a few frames at a time
}

async function convert(frame: VideoFrame, picture: Deferred<ImageBitmap>): Promise<void> {
  try {
    picture.resolve(await createImageBitmap(frame));
  } catch (error) {
    picture.reject(error);
  } finally {
    frame.close();
  }
}

function fail(error: Error): void {
  decoder = null;
  const pictures = [...awaited.values()];
  awaited.clear();
  for (const picture of pictures) picture.reject(error);
}
