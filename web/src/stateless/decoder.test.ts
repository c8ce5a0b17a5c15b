import { expect, test } from "vitest";
import { type DecodeReply, type DecodeRequest, Decoder, type DecodeWorker } from "./decoder";

class FakeWorker {
  onmessage: DecodeWorker["onmessage"] = null;
  onerror: DecodeWorker["onerror"] = null;
  readonly asked: DecodeRequest[] = [];
  terminated = false;

  postMessage(message: DecodeRequest): void {
    this.asked.push(message);
  }

  terminate(): void {
    this.terminated = true;
  }

  answer(reply: DecodeReply): void {
    this.onmessage?.call(this as unknown as Worker, { data: reply } as MessageEvent);
  }
}

function bitmap(): ImageBitmap & { closed: boolean } {
  const fake = { closed: false, close: () => Object.assign(fake, { closed: true }) };
  return fake as unknown as ImageBitmap & { closed: boolean };
}

const decoder = () => {
  const worker = new FakeWorker();
  return { worker, subject: new Decoder(worker as unknown as DecodeWorker) };
};
const never = new AbortController().signal;

test("answers find their requests in any order", async () => {
  const { worker, subject } = decoder();
  const first = subject.decode(new Blob(), never);
  const second = subject.decode(new Blob(), never);
  const [a, b] = [bitmap(), bitmap()];
  worker.answer({ id: worker.asked[1]?.id ?? -1, bitmap: b });
  worker.answer({ id: worker.asked[0]?.id ?? -1, bitmap: a });
  expect(await first).toBe(a);
  expect(await second).toBe(b);
});

test("a bitmap that nobody wants any more is closed", async () => {
  const { worker, subject } = decoder();
  const abort = new AbortController();
  const decoding = subject.decode(new Blob(), abort.signal);
  abort.abort(new Error("overtaken"));
  const late = bitmap();
  worker.answer({ id: 0, bitmap: late });
  await expect(decoding).rejects.toThrow("overtaken");
  expect(late.closed).toBe(true);
});

test("what is no image rejects", async () => {
  const { worker, subject } = decoder();
  const decoding = subject.decode(new Blob(), never);
  worker.answer({ id: 0, error: "InvalidStateError" });
  await expect(decoding).rejects.toThrow("InvalidStateError");
});

test("disposing ends the worker and all that waits, and closes what still comes", async () => {
  const { worker, subject } = decoder();
  const decoding = subject.decode(new Blob(), never);
  subject.dispose();
  await expect(decoding).rejects.toThrow("disposed");
  expect(worker.terminated).toBe(true);
  const late = bitmap();
  worker.answer({ id: 0, bitmap: late });
  expect(late.closed).toBe(true);
});
