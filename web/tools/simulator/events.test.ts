import { expect, test } from "vitest";
import { seeded } from "#client/abr/random";
import { EventLoop } from "./events";

test("events come in order of time, those of one time in order of their making", async () => {
  const loop = new EventLoop();
  const random = seeded(1);
  const seen: number[] = [];
  for (let i = 0; i < 500; i++) {
    const at = Math.floor(random() * 50);
    loop.at(at, () => seen.push(at * 1000 + i));
  }
  await loop.run(100);
  expect(seen).toHaveLength(500);
  expect(seen).toEqual(seen.toSorted((a, b) => a - b));
  expect(loop.now()).toBe(100);
});

test("promises settle before time goes on", async () => {
  const loop = new EventLoop();
  const seen: number[] = [];
  loop.at(1, () => {
    loop.settle();
    void Promise.resolve()
      .then(() => undefined)
      .then(() => seen.push(loop.now()));
  });
  loop.at(2, () => seen.push(loop.now()));
  await loop.run(5);
  expect(seen).toEqual([1, 2]);
});
