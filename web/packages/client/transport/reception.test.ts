import { expect, test } from "vitest";
import { turn } from "#fakes/transport";
import { Receiver, readAll } from "./reception";

function stream(): {
  readable: ReadableStream<Uint8Array<ArrayBuffer>>;
  push(bytes: number): void;
  end(): void;
  cancelled: unknown[];
} {
  const cancelled: unknown[] = [];
  let controller: ReadableStreamDefaultController<Uint8Array<ArrayBuffer>> | undefined;
  const readable = new ReadableStream<Uint8Array<ArrayBuffer>>({
    start: (given) => {
      controller = given;
    },
    cancel: (reason) => {
      cancelled.push(reason);
    },
  });
  return {
    readable,
    cancelled,
    push: (bytes) => controller?.enqueue(new Uint8Array(bytes)),
    end: () => controller?.close(),
  };
}

test("times a reply from the request to its last byte, not to the stream's end", async () => {
  let now = 100;
  const receiver = new Receiver(() => now);
  const reception = receiver.begin();
  const source = stream();
  const reading = readAll(source.readable, reception, new AbortController().signal);
  const at = async (time: number, bytes: number) => {
    now = time;
    source.push(bytes);
    await turn();
  };
  await at(150, 10);
  await at(170, 20);
  now = 999;
  source.end();
  expect((await reading).map(({ byteLength }) => byteLength)).toEqual([10, 20]);
  expect(reception.arrival).toEqual({ sentAt: 100, firstByteAt: 150, lastByteAt: 170, bytes: 30, sharedBytes: 20 });
});

test("bytes of other replies count between the first and the last byte, and only there", () => {
  let now = 0;
  const receiver = new Receiver(() => now);
  const [mine, other] = [receiver.begin(), receiver.begin()];
  other.add(1000);
  now = 10;
  mine.add(1);
  other.add(100);
  now = 20;
  mine.add(2);
  other.add(5000);
  expect(mine.arrival).toMatchObject({ bytes: 3, sharedBytes: 102 });
});

test("aborting cancels the stream, which tells the server to stop", async () => {
  const abort = new AbortController();
  const source = stream();
  const reading = readAll(source.readable, new Receiver(() => 0).begin(), abort.signal);
  source.push(5);
  await turn();
  abort.abort(new Error("overtaken"));
  await expect(reading).rejects.toThrow("overtaken");
  expect(source.cancelled).toHaveLength(1);
});

test("a stream that was not wanted from the start is cancelled unread", async () => {
  const source = stream();
  const reading = readAll(source.readable, new Receiver(() => 0).begin(), AbortSignal.abort(new Error("too late")));
  await expect(reading).rejects.toThrow("too late");
  expect(source.cancelled).toHaveLength(1);
});

test("of a first chunk of several packets only the first is what the clock started with", () => {
  let now = 0;
  const reception = new Receiver(() => now).begin();
  reception.add(5000);
  expect(reception.arrival).toMatchObject({ bytes: 5000, sharedBytes: 5000 - 1424, firstByteAt: 0, lastByteAt: 0 });
  now = 4;
  reception.add(100);
  expect(reception.arrival).toMatchObject({ bytes: 5100, sharedBytes: 5100 - 1424, lastByteAt: 4 });
});
