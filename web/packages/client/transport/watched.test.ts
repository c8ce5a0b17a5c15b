import { beforeEach, expect, test } from "vitest";
import { FakeTransport, settle } from "#fakes/transport";
import { FrameDropped, RequestProblem } from "./transport";
import { MIN_PATIENCE, WatchedTransport } from "./watched";

const request = (seq: number) => ({ scene: "s", seq, fx: 1, fy: 1, cx: 1, cy: 1, width: 2, height: 2 });
let now: number;
let fake: FakeTransport;
let subject: WatchedTransport;

beforeEach(() => {
  now = 0;
  fake = new FakeTransport(() => now);
  subject = new WatchedTransport(fake, () => now);
});

function ask(seq: number, signal = new AbortController().signal): void {
  subject.request(request(seq), signal).catch(() => undefined);
}

/** One request, answered after this delay. */
async function answered(seq: number, after: number): Promise<void> {
  ask(seq);
  now += after;
  fake.requests.at(-1)?.reply();
  await settle();
}

test("without requests nothing is missing", async () => {
  await answered(0, 20);
  now += 60_000;
  expect(subject.silent).toBe(false);
});

test("a request that is not answered is silence, and the next answer ends it", async () => {
  ask(0);
  now = MIN_PATIENCE;
  expect(subject.silent).toBe(false);
  now += 1;
  expect(subject.silent).toBe(true);
  ask(1);
  fake.requests[1]?.fail(new RequestProblem({ type: "", title: "", status: 503, detail: "" }));
  await settle();
  expect(subject.silent).toBe(false);
});

test("one slow answer among others is no silence", async () => {
  ask(0);
  for (let seq = 1; seq < 100; seq++) await answered(seq, 50);
  expect(subject.silent).toBe(false);
});

test("a slow link is given more time", async () => {
  await answered(0, 1000);
  ask(1);
  now += 7000;
  expect(subject.silent).toBe(false);
  now += 1001;
  expect(subject.silent).toBe(true);
});

test("requests that get lost one by one are silence, too", async () => {
  for (let seq = 0; seq < 10; seq++) {
    ask(seq);
    now += 250;
    fake.requests.at(-1)?.fail(new FrameDropped("the frame got lost"));
    await settle();
  }
  expect(subject.silent).toBe(true);
});

test("what nobody waits for any more is not missed", async () => {
  const abort = new AbortController();
  ask(0, abort.signal);
  abort.abort();
  await settle();
  now += 10_000;
  expect(subject.silent).toBe(false);
});
