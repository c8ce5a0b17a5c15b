import { expect, test } from "vitest";
import { LeadTime } from "./lead-time";

/** Frames on screen at a fixed interval, each with the same delay after its request. */
function watched(lead: LeadTime, { delay, every, count = 30, from = 1000 }: Record<string, number>): number {
  let at = from as number;
  for (let i = 0; i < (count as number); i++, at += every as number) lead.shown(at - (delay as number), at);
  return at;
}

test("is how long a frame takes to the screen, and half of how long it stays there", () => {
  const lead = new LeadTime();
  expect(lead.ahead).toBe(0);
  watched(lead, { delay: 120, every: 20 });
  expect(lead.ahead).toBe(130);
});

test("follows the network within a few frames, and not a single one that is late", () => {
  const lead = new LeadTime();
  const at = watched(lead, { delay: 40, every: 10 });
  lead.shown(at - 900, at);
  expect(lead.ahead).toBe(45);
  watched(lead, { delay: 300, every: 10, count: 8, from: at + 300 });
  expect(lead.ahead).toBe(305);
});

test("a rest is no long interval between frames", () => {
  const lead = new LeadTime();
  const at = watched(lead, { delay: 50, every: 20 });
  watched(lead, { delay: 50, every: 10_000, count: 20, from: at + 10_000 });
  expect(lead.ahead).toBe(60);
});

test("a video that goes on while the camera rests is not late", () => {
  const lead = new LeadTime();
  let at = watched(lead, { delay: 100, every: 20 });
  for (const asked = at - 100; at < 9000; at += 20) lead.shown(asked, at);
  expect(lead.ahead).toBe(110);
});

test("looks half a second ahead at most, and nowhere on a new connection", () => {
  const lead = new LeadTime();
  watched(lead, { delay: 4000, every: 200 });
  expect(lead.ahead).toBe(500);
  lead.clear();
  expect(lead.ahead).toBe(0);
});
