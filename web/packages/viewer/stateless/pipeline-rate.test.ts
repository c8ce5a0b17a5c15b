import { describe, expect, test } from "vitest";
import { FakeTransport, settle } from "#fakes/transport";
import { view } from "#fakes/views";
import { FramePipeline } from "./pipeline";

/** Walks for some seconds against a server with this round trip and service time (ms); returns frames shown a second. */
async function walk(roundTrip: number, service: number): Promise<{ rate: number; inFlight: number }> {
  let now = 0;
  const transport = new FakeTransport(() => now);
  const decode = async () => ({ bitmap: { close: () => undefined } as ImageBitmap, depth: null });
  const subject = new FramePipeline(transport, decode, () => now, {
    sent: () => undefined,
    replied: () => undefined,
    refused: () => undefined,
    unrefined: () => undefined,
    format: () => "jpeg",
    transmission: () => 0,
  });
  let shown = 0;
  let free = 0;
  let measured = 0;
  let most = 0;
  const waiting = new Set<number>();
  const due: { at: number; reply: () => void }[] = [];
  const until = 12_000;
  let handled = 0;
  for (now = 0; now < until; now += 1) {
    if (now % 16 === 0) {
      subject.want(view(now), 0);
      const taken = subject.take();
      if (taken && now > 6000) shown++;
      if (now > 6000) most = Math.max(most, subject.inFlight);
    }
    while (handled < transport.requests.length) waiting.add(handled++);
    if (now >= free) {
      // newest first, as the engine does it; a request reaches the server after half of the round trip
      const here = [...waiting].filter((i) => {
        const request = transport.requests[i];
        return request && !request.signal.aborted && request.sentAt + roundTrip / 2 <= now;
      });
      const next = here.at(-1);
      const request = next === undefined ? undefined : transport.requests[next];
      if (next !== undefined && request) {
        waiting.delete(next);
        free = now + service;
        const queue = now - request.sentAt - roundTrip / 2;
        const timing = { queue, render: service, encode: 0 };
        due.push({ at: free + roundTrip / 2, reply: () => request.reply({ timing }) });
      }
    }
    for (const entry of due.splice(0)) {
      if (entry.at <= now) entry.reply();
      else due.push(entry);
    }
    await settle();
    measured = now - 6000;
  }
  return { rate: (shown * 1000) / measured, inFlight: most };
}

describe("the frame rate does not fall with the round trip", () => {
  test.each([
    [2, 20],
    [100, 20],
    [300, 20],
    [2, 60],
    [300, 60],
  ])(
    "round trip %i ms, service %i ms",
    async (roundTrip, service) => {
      const { rate, inFlight } = await walk(roundTrip, service);
      // The server could answer 1000 / service a second; one animation frame may be lost to its beat.
      expect(rate).toBeGreaterThan(0.85 * Math.min(1000 / 16, 1000 / (service + 8)));
      expect(inFlight).toBeLessThanOrEqual(Math.ceil((roundTrip + service) / 16) + 2);
    },
    30_000,
  );
});
