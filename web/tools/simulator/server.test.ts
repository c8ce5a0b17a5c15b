import { expect, test } from "vitest";
import { Bottleneck } from "./bottleneck";
import type { Endpoints } from "./endpoints";
import { EventLoop } from "./events";
import { Sender } from "./sender";
import { Server } from "./server";
import { parseTrace } from "./trace";

/** Requests frames at the given times; returns each one's queue, or its refusal. */
async function answers(requests: readonly number[], { render = 20, encode = 5 } = {}) {
  const events = new EventLoop();
  const sender = new Sender(events, {
    link: new Bottleneck(parseTrace("t_ms,down_kbps\n0,100000\n"), "down_kbps"),
    down: () => 0,
    back: (_, arrived) => events.at(events.now(), arrived),
    loses: () => false,
  });
  const endpoints: Endpoints = {
    render: () => render,
    encode: () => encode,
    bytes: () => 1000,
    heard: (now) => now,
    decode: () => 0,
    nextAnimationFrame: (now) => now,
    turning: () => 0,
  };
  const server = new Server(events, sender, endpoints);
  const told: { number: number; at: number; queue: number | null }[] = [];
  for (const [number, at] of requests.entries()) {
    events.at(at, () =>
      server.request({
        number,
        rung: 0,
        received: () => undefined,
        answered: (_, { queue }) => told.push({ number, at: events.now(), queue }),
        refused: () => told.push({ number, at: events.now(), queue: null }),
      }),
    );
  }
  await events.run(10_000);
  return told;
}

test("a frame takes rendering and encoding", async () => {
  expect(await answers([3])).toEqual([{ number: 0, at: 28, queue: 0 }]);
});

test("the newest goes first, and one too many pushes the oldest out", async () => {
  const told = await answers([0, 1, 2, 3, 4, 5]);
  expect(told.map(({ number, queue }) => [number, queue === null])).toEqual([
    [1, true],
    [0, false],
    [5, false],
    [4, false],
    [3, false],
    [2, false],
  ]);
});

test("one frame is encoded while the next is rendered", async () => {
  expect((await answers([0, 0], { render: 20, encode: 5 })).map(({ at }) => at)).toEqual([25, 45]);
  expect((await answers([0, 0, 0], { render: 5, encode: 20 })).map(({ at }) => at)).toEqual([25, 45, 65]);
});

test("a third is not begun meanwhile, so that a newer one can still go first", async () => {
  const told = await answers([0, 0, 0, 20], { render: 5, encode: 20 });
  expect(told.map(({ number }) => number)).toEqual([0, 2, 3, 1]);
});
