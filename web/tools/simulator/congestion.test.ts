import { expect, test } from "vitest";
import { NewReno, PACKET, Pacer, type Packet, Westwood } from "./congestion";

/** Sends packets at a time until the window is full. */
function fill(congestion: NewReno, first: number, sentAt: number) {
  const packets = [];
  for (let number = first; congestion.room; number++) {
    packets.push({ number, bytes: PACKET, sentAt });
    congestion.sent({ number, bytes: PACKET, sentAt });
  }
  return packets;
}

test("slow start doubles a full window, a loss halves it, and then it grows by a packet", () => {
  const congestion = new NewReno();
  const first = fill(congestion, 0, 0);
  for (const packet of first) congestion.acknowledged(packet);
  expect(congestion.window).toBe(20 * PACKET);
  const [lost, ...others] = fill(congestion, first.length, 10);
  if (lost) congestion.lost(lost, 20);
  expect(congestion.window).toBe(10 * PACKET);
  for (const packet of others) congestion.acknowledged(packet); // sent before the loss was detected
  expect(congestion.window).toBe(10 * PACKET);
  for (const packet of fill(congestion, 100, 30)) congestion.acknowledged(packet);
  expect(congestion.window).toBe(11 * PACKET);
});

test("losses of one round trip count once, and two packets are always let out", () => {
  const congestion = new NewReno();
  for (const packet of fill(congestion, 0, 0)) congestion.lost(packet, 20);
  expect(congestion.window).toBe(5 * PACKET);
  for (let i = 1; i < 9; i++)
    for (const packet of fill(congestion, 100 * i, 50 * i)) congestion.lost(packet, 50 * i + 20);
  expect(congestion.window).toBe(2 * PACKET);
});

test("a window that was not full does not grow", () => {
  const congestion = new NewReno();
  const packet = { number: 0, bytes: PACKET, sentAt: 0 };
  congestion.sent(packet);
  congestion.acknowledged(packet);
  expect(congestion.window).toBe(10 * PACKET);
});

test("slow start ends when the round trip grows by a quarter", () => {
  const congestion = new NewReno();
  for (let i = 0; i < 5; i++) congestion.measured(20, 10 * i);
  for (let i = 5; i < 15; i++) congestion.measured(26, 10 * i);
  for (const packet of fill(congestion, 0, 200)) congestion.acknowledged(packet);
  expect(congestion.window).toBe(11 * PACKET);
});

test("the pacer lets out 1.25 windows a round trip, after a burst of a quarter of one", () => {
  const pacer = new Pacer();
  expect(pacer.next(0)).toBe(0);
  pacer.update(40 * PACKET, 100); // a packet every 2 ms
  let sent = 0;
  for (let now = 1000; now < 1100; now = Math.max(now, pacer.next(now))) {
    if (pacer.next(now) > now) continue;
    pacer.sent();
    sent++;
  }
  expect(sent).toBeGreaterThanOrEqual(58);
  expect(sent).toBeLessThanOrEqual(62);
});

test("random loss costs Westwood nothing, and NewReno its window", () => {
  /** A link of one packet per millisecond and 100 ms, which loses each hundredth packet; the window after 5 s. */
  function window(congestion: NewReno | Westwood): number {
    const flying: { arrival: number; packet: Packet }[] = [];
    let [now, freeAt, number] = [0, 0, 0];
    while (now < 5000) {
      while (congestion.room) {
        const packet = { number: number++, bytes: PACKET, sentAt: now };
        congestion.sent(packet);
        freeAt = Math.max(freeAt, now) + 1;
        flying.push({ arrival: freeAt + 100, packet });
      }
      const next = flying.shift();
      if (next === undefined) throw new Error("nothing is in flight");
      now = next.arrival;
      if (next.packet.number % 100 === 99) congestion.lost(next.packet, now);
      else congestion.acknowledged(next.packet, now);
      congestion.measured(now - next.packet.sentAt, now);
    }
    return congestion.window / PACKET;
  }
  expect(window(new NewReno())).toBeLessThan(25);
  expect(window(new Westwood())).toBeGreaterThan(60);
});
