import { expect, test } from "vitest";
import type { Shaper } from "../network/shaper";
import type { ShaperStatus } from "../wire/shaper";
import { linkFor, linkProblem, presentNetwork } from "./link";
import { constantLink, UNSHAPED } from "./plan";

const LINK = { down_kbps: 8000, up_kbps: 4000, delay_ms: 40, jitter_ms: 0, loss_pct: 0 };
const DIRECTION = { target_kbps: 8000, delivered_kbps: 7000, queue_bytes: 0, queue_ms: 0, drops: 0 };
const CONSTANT: ShaperStatus = {
  time_ms: 1000,
  mode: "constant",
  trace: null,
  position_ms: null,
  duration_ms: null,
  loop: false,
  link: LINK,
  down: DIRECTION,
  up: DIRECTION,
  backend: "netem",
  closed: null,
};
const PLAYING: ShaperStatus = {
  ...CONSTANT,
  mode: "playing",
  trace: "bus",
  position_ms: 12_000,
  duration_ms: 30_000,
  loop: true,
};
const BUS = { link: null, trace: "bus", rtt_ms: 80 };
const AS_IT_IS = constantLink(LINK);
const CHANGED = "The link was changed from outside during the run.";

test.each<[string, Partial<ShaperStatus>, string | null]>([
  ["played on", { position_ms: 12_200 }, null],
  ["began again at its end", { time_ms: 20_000, position_ms: 1000 }, null],
  ["was told of late", { time_ms: 61_000, position_ms: 12_010 }, null],
  ["has other rates meanwhile", { position_ms: 12_200, link: { ...LINK, down_kbps: 500 } }, null],
  ["began again before its end", { position_ms: 0 }, CHANGED],
  ["jumped forward", { time_ms: 5000, position_ms: 28_000 }, CHANGED],
  ["was sought back", { position_ms: 5000 }, CHANGED],
  ["was paused", { mode: "paused" }, CHANGED],
  ["was stopped", { ...CONSTANT, time_ms: 1200 }, CHANGED],
  ["is another", { trace: "train", position_ms: 12_200 }, CHANGED],
  ["has another delay", { position_ms: 12_200, link: { ...LINK, delay_ms: 10 } }, CHANGED],
  [
    "was cut off",
    { position_ms: 12_200, closed: "The interface has gone." },
    "The link was closed during the run: The interface has gone.",
  ],
])("a trace that %s", (_, change, said) => {
  expect(linkProblem(BUS, PLAYING, { ...PLAYING, time_ms: 1200, ...change })).toBe(said);
});

test("a trace's own delay may change", () => {
  const later = { ...PLAYING, time_ms: 1200, position_ms: 12_200, link: { ...LINK, delay_ms: 10 } };
  expect(linkProblem({ ...BUS, rtt_ms: null }, PLAYING, later)).toBeNull();
});

test.each<[string, Partial<ShaperStatus>, string | null]>([
  ["stays", {}, null],
  ["is that of a trace which was paused", { ...PLAYING, mode: "paused" }, null],
  ["has another rate", { link: { ...LINK, up_kbps: 5000 } }, CHANGED],
  ["is that of a trace which plays", PLAYING, CHANGED],
])("a link as it is that %s", (_, change, said) => {
  expect(linkProblem(AS_IT_IS, CONSTANT, { ...CONSTANT, ...change, time_ms: 1200 })).toBe(said);
});

const shaper = (status: ShaperStatus | null, connectionError: string | null = null) =>
  ({
    api: {},
    status: { value: status, peek: () => status },
    connectionError: { value: connectionError, peek: () => connectionError },
  }) as unknown as Shaper;

test("the link as it is has the shaper's present conditions", () => {
  expect(presentNetwork(null)).toEqual(UNSHAPED);
  expect(presentNetwork(shaper(CONSTANT))).toEqual(AS_IT_IS);
  expect(presentNetwork(shaper(PLAYING))).toMatch(/^The trace bus plays on the link/);
  expect(presentNetwork(shaper(null, "The shaper is away."))).toBe("The shaper is away.");
});

test("the link as it is must be the same as when the experiment began, and is left alone", async () => {
  const run = { network: AS_IT_IS };
  const link = linkFor(shaper(CONSTANT), run);
  await link.hold();
  expect(await link.play()).toBe(CONSTANT);
  await link.release();
  const other = { ...CONSTANT, link: { ...LINK, down_kbps: 5000 } };
  await expect(linkFor(shaper(other), run).hold()).rejects.toThrow("The link is not 8mbit,4mbit-up,80ms-rtt any more");
  await expect(linkFor(shaper(null, "The shaper is away."), run).hold()).rejects.toThrow("The shaper is away.");
  expect(() => linkFor(null, run)).toThrow("There is no shaper");
});

test("a trace is held at its start at the round trip that was asked for, played from there, and given back", async () => {
  const asked: unknown[] = [];
  const calls = ["start", "pause", "seek", "resume", "stop"].map((name) => {
    const call = async (...args: unknown[]) => {
      asked.push([name, ...args]);
      return PLAYING;
    };
    return [name, call];
  });
  const api = Object.fromEntries(calls);
  const link = linkFor({ api } as unknown as Shaper, { network: BUS });
  await link.hold();
  expect(asked).toEqual([["start", { trace: "bus", loop: true, delay_ms: 40 }], ["pause"], ["seek", 0]]);
  asked.length = 0;
  expect(await link.play()).toBe(PLAYING);
  await link.release();
  expect(asked).toEqual([["seek", 0], ["resume"], ["stop"]]);
});
