import { expect, test } from "vitest";
import type { CalledWorker, WorkerAnswer, WorkerCall } from "#client/async/worker-calls";
import { type DecodedImage, Decoder } from "./decoder";

class FakeWorker {
  onmessage: CalledWorker["onmessage"] = null;
  onerror: CalledWorker["onerror"] = null;
  readonly asked: WorkerCall<Blob>[] = [];
  terminated = false;

  postMessage(message: WorkerCall<Blob>): void {
    this.asked.push(message);
  }

  terminate(): void {
    this.terminated = true;
  }

  answer(reply: WorkerAnswer<DecodedImage>): void {
    this.onmessage?.call(this as unknown as Worker, { data: reply } as MessageEvent);
  }
}

function bitmap(): ImageBitmap & { closed: boolean } {
  const fake = { closed: false, close: () => Object.assign(fake, { closed: true }) };
  return fake as unknown as ImageBitmap & { closed: boolean };
}

const decoder = () => {
  const worker = new FakeWorker();
  return { worker, subject: new Decoder(worker as unknown as CalledWorker) };
};
const never = new AbortController().signal;

test("answers find their requests in any order", async () => {
  const { worker, subject } = decoder();
  const first = subject.decode(new Blob(), never);
  const second = subject.decode(new Blob(), never);
  const codes = Uint8Array.of(1, 2);
  const [a, b] = [
    { bitmap: bitmap(), depth: null },
    { bitmap: bitmap(), depth: { width: 2, height: 1, nearest: 1, codes } },
  ];
  worker.answer({ id: worker.asked[1]?.id ?? -1, value: b });
  worker.answer({ id: worker.asked[0]?.id ?? -1, value: a });
  expect(await first).toBe(a);
  expect(await second).toBe(b);
});

test("a bitmap that nobody wants any more is closed", async () => {
  const { worker, subject } = decoder();
  const abort = new AbortController();
  const decoding = subject.decode(new Blob(), abort.signal);
  abort.abort(new Error("overtaken"));
  const late = bitmap();
  worker.answer({ id: 0, value: { bitmap: late, depth: null } });
  await expect(decoding).rejects.toThrow("overtaken");
  expect(late.closed).toBe(true);
});

test("what is no image rejects", async () => {
  const { worker, subject } = decoder();
  const decoding = subject.decode(new Blob(), never);
  worker.answer({ id: 0, error: { name: "InvalidStateError", message: "it is no image" } });
  await expect(decoding).rejects.toMatchObject({ name: "InvalidStateError" });
});

test("disposing ends the worker and all that waits, and closes what still comes", async () => {
  const { worker, subject } = decoder();
  const decoding = subject.decode(new Blob(), never);
  subject.dispose();
  await expect(decoding).rejects.toThrow("the worker was ended");
  expect(worker.terminated).toBe(true);
  const late = bitmap();
  worker.answer({ id: 0, value: { bitmap: late, depth: null } });
  expect(late.closed).toBe(true);
});
