import { expect, test } from "vitest";
import { seeded } from "#client/abr/random";
import { Bottleneck } from "./bottleneck";
import { EventLoop } from "./events";
import { Sender } from "./sender";
import { parseTrace } from "./trace";

/**
 * Sends frames of the given sizes, numbers and times over a constant link; returns their order and times of completion.
 */
async function sent(
  frames: readonly { number: number; bytes: number; at: number; cancelAt?: number }[],
  { kbps = 20_000, delay = 10, loses = (): boolean => false } = {},
) {
  const events = new EventLoop();
  const sender = new Sender(events, {
    link: new Bottleneck(parseTrace(`t_ms,down_kbps\n0,${kbps}\n`), "down_kbps"),
    down: () => delay,
    back: (_, arrived) => events.at(events.now() + delay, arrived),
    loses,
  });
  const complete: { number: number; at: number }[] = [];
  for (const { number, bytes, at, cancelAt } of frames) {
    let missing = bytes;
    const stream = {
      number,
      remaining: bytes,
      received: (count: number) => {
        missing -= count;
        if (missing === 0) complete.push({ number, at: events.now() });
      },
    };
    events.at(at, () => sender.send(stream));
    if (cancelAt !== undefined) events.at(cancelAt, () => sender.cancel(stream));
  }
  await events.run(60_000);
  return complete;
}

test("a small frame takes its transmission and the way", async () => {
  const [frame] = await sent([{ number: 0, bytes: 7000, at: 0 }]);
  expect(frame?.at).toBeCloseTo(((7000 + 5 * 70) * 8) / 20_000 + 10, 6);
});

test("frames do not share the link: the oldest request's goes first, though another was ready before", async () => {
  const complete = await sent([
    { number: 1, bytes: 100_000, at: 0 },
    { number: 0, bytes: 20_000, at: 5 },
  ]);
  expect(complete.map(({ number }) => number)).toEqual([0, 1]);
});

test("whatever the queue loses is sent again", async () => {
  const complete = await sent([{ number: 0, bytes: 400_000, at: 0 }], { kbps: 2000 });
  expect(complete).toHaveLength(1);
  expect(complete[0]?.at).toBeGreaterThan((400_000 * 8) / 2000);
});

test("what is cancelled is not sent, not even again", async () => {
  const complete = await sent(
    [
      { number: 0, bytes: 400_000, at: 0, cancelAt: 300 },
      { number: 1, bytes: 20_000, at: 0 },
    ],
    { kbps: 2000 },
  );
  expect(complete.map(({ number }) => number)).toEqual([1]);
  expect(complete[0]?.at).toBeLessThan(1000);
});

test("on a link that loses packets at random, few frames wait for a retransmission", async () => {
  const random = seeded(3);
  const frames = Array.from({ length: 200 }, (_, number) => ({ number, bytes: 20_000, at: number * 50 }));
  const complete = await sent(frames, { kbps: 50_000, delay: 50, loses: () => random() < 0.02 });
  const late = complete.filter(({ number, at }) => at - number * 50 > 120);
  expect(complete).toHaveLength(frames.length);
  expect(late.length).toBeLessThan(10); // a packet in four frames is lost
});
