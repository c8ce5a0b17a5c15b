import { expect, test } from "vitest";
import { Bottleneck } from "./bottleneck";
import { EventLoop } from "./events";
import { MeasuredEndpoints } from "./measured";
import { Sender } from "./sender";
import { Server } from "./server";
import { parseTrace } from "./trace";

/** Asks for frames at times; tells what became of each: its queue, or that it was refused. */
async function answers(requests: readonly number[], { render = 20, encode = 5 } = {}) {
  const events = new EventLoop();
  const sender = new Sender(events, {
    link: new Bottleneck(parseTrace("t_ms,down_kbps\n0,100000\n"), "down_kbps"),
    down: () => 0,
    back: (_, arrived) => events.at(events.now(), arrived),
    loses: () => false,
  });
  const measured = {
    rungs: [{ render_ms: render, encode_ms: encode, page_ms: 0 }],
    views: [{ t_ms: 0, bytes: [1000] }],
    animation: [],
  };
  const server = new Server(events, sender, MeasuredEndpoints.parse(JSON.stringify(measured), 1));
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
