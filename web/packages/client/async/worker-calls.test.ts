import { beforeEach, expect, test } from "vitest";
import { type CalledWorker, type WorkerAnswer, type WorkerCall, WorkerCalls } from "./worker-calls";

let asked: WorkerCall<string>[];
let worker: CalledWorker & { ended?: boolean };
let calls: WorkerCalls<string, number>;

beforeEach(() => {
  asked = [];
  worker = {
    postMessage: (call: WorkerCall<string>) => asked.push(call),
    terminate: () => {
      worker.ended = true;
    },
    onmessage: null,
    onerror: null,
  };
  calls = new WorkerCalls(worker);
});

function answers(answer: WorkerAnswer<number>): void {
  worker.onmessage?.call(worker as Worker, { data: answer } as MessageEvent);
}

test("each call gets its own answer, in whatever order they come", async () => {
  const [one, two] = [calls.call("one"), calls.call("two")];
  expect(asked.map(({ request }) => request)).toEqual(["one", "two"]);
  answers({ id: asked[1]?.id ?? -1, value: 2 });
  answers({ id: asked[0]?.id ?? -1, value: 1 });
  expect(await Promise.all([one, two])).toEqual([1, 2]);
});

test("a failure keeps its name", async () => {
  const call = calls.call("one");
  answers({ id: 0, error: { name: "QuotaExceededError", message: "full" } });
  await expect(call).rejects.toMatchObject({ name: "QuotaExceededError", message: "full" });
});

test("a worker that fails, fails all calls, those of later, too", async () => {
  const call = calls.call("one");
  worker.onerror?.call(worker as Worker, { message: "gone" } as ErrorEvent);
  await expect(call).rejects.toThrow("gone");
  await expect(calls.call("two")).rejects.toThrow("gone");
});

test("whoever waits when it is ended hears of it", async () => {
  const call = calls.call("one");
  calls.dispose();
  expect(worker.ended).toBe(true);
  await expect(call).rejects.toThrow("ended");
});
