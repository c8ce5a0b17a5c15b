import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { fragments, frameBytes } from "#fakes/frames";
import { turn } from "#fakes/transport";
import { FakeSession } from "#fakes/web-transport";
import { DatagramTransport } from "./datagrams";
import { FrameDropped } from "./transport";

const never = new AbortController().signal;
const request = (seq: number) => ({ scene: "s", seq, fx: 1, fy: 1, cx: 1, cy: 1, width: 2, height: 2 });
let fake: FakeSession;
let subject: DatagramTransport;

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] });
  fake = new FakeSession();
  subject = new DatagramTransport(fake.session, () => 0);
});
afterEach(() => {
  vi.useRealTimers();
});

/** The datagrams of one frame. */
function datagrams(seq: number, size = 40): Uint8Array[] {
  const whole = frameBytes({ status: 200, seq, content_type: "image/jpeg" }, new Uint8Array(100));
  return fragments(seq, whole, size);
}

test("a frame comes back in fragments, in any order", async () => {
  const reply = subject.request(request(4), never);
  await turn();
  expect(JSON.parse(fake.sent[0] ?? "")).toEqual(request(4));
  for (const datagram of datagrams(4).reverse()) fake.deliver(datagram);
  expect((await reply).header.seq).toBe(4);
  expect((await reply).image.size).toBe(100);
});

test("a frame that misses a fragment is dropped when a newer one is complete", async () => {
  const [old, newer] = [subject.request(request(1), never), subject.request(request(2), never)];
  const lost = expect(old).rejects.toThrow(FrameDropped);
  await turn();
  for (const datagram of datagrams(1).slice(1)) fake.deliver(datagram);
  for (const datagram of datagrams(2)) fake.deliver(datagram);
  expect((await newer).header.seq).toBe(2);
  await lost;
});

test("a frame that never comes is given up after a while", async () => {
  const reply = subject.request(request(1), never);
  const lost = expect(reply).rejects.toThrow("the frame got lost");
  await turn();
  vi.advanceTimersByTime(2000);
  await lost;
});

test("a request that fits in no datagram is refused at once", async () => {
  const small = new DatagramTransport(new FakeSession({ maxDatagramSize: 50 }).session, () => 0);
  await expect(small.request(request(1), never)).rejects.toThrow("fits in no datagram");
});

test("a cancelled frame rejects with the reason, and its late fragments are ignored", async () => {
  const abort = new AbortController();
  const reply = subject.request(request(1), abort.signal);
  await turn();
  abort.abort(new Error("overtaken"));
  await expect(reply).rejects.toThrow("overtaken");
  const next = subject.request(request(2), never);
  await turn();
  for (const datagram of [...datagrams(1), ...datagrams(2)]) fake.deliver(datagram);
  expect((await next).header.seq).toBe(2);
});

test("made-up bytes fail their own frame only", async () => {
  const [bad, good] = [subject.request(request(1), never), subject.request(request(2), never)];
  const refused = expect(bad).rejects.toThrow();
  await turn();
  fake.deliver(new Uint8Array([0, 0, 0, 1, 0, 0, 0, 1, 255, 255, 255, 255]));
  for (const datagram of datagrams(2)) fake.deliver(datagram);
  await refused;
  expect((await good).header.seq).toBe(2);
});
