import { signal } from "@preact/signals";
import { expect, test } from "vitest";
import type { ShaperStatus } from "#client/wire/shaper";
import type { Configuration } from "#client/wire/store";
import { CONSTANT, LINK, PLAYING } from "#fakes/shaper";
import labels from "../../../../tests/experiments/wire/network_labels.golden.json";
import type { Shaper } from "../network/shaper";
import { networkLabel, presentNetwork, RunLink } from "./link";

const BUS = { trace: "bus", rtt_ms: 80 };
const CHANGED = "The link was changed from outside during the run.";

/** A shaper that answers every request with a status, and a log of the requests. */
function fakeShaper(answer: ShaperStatus) {
  const asked: unknown[] = [];
  const call =
    (name: string) =>
    async (...values: unknown[]) => {
      asked.push([name, ...values]);
      return answer;
    };
  const names = ["start", "seek", "stop", "link"];
  const api = Object.fromEntries(names.map((name) => [name, call(name)]));
  const status = signal<ShaperStatus | null>(null);
  const connectionError = signal<string | null>(null);
  return { asked, status, connectionError, shaper: { api, status, connectionError } as unknown as Shaper };
}

/** Problems reported for a run's link that goes through these states. */
async function seen(network: Configuration["network"], first: ShaperStatus, ...later: (ShaperStatus | null)[]) {
  const { shaper, status, connectionError } = fakeShaper(first);
  const link = new RunLink(shaper, network, 0);
  await link.begin();
  await link.play();
  const problems: string[] = [];
  const stop = link.watch(
    () => 0,
    (sentence) => problems.push(sentence),
  );
  for (const state of later) {
    if (state === null) connectionError.value = "The shaper is away.";
    status.value = state;
  }
  stop();
  return problems[0] ?? null;
}

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
])("a trace that %s", async (_, change, said) => {
  expect(await seen(BUS, PLAYING, { ...PLAYING, time_ms: 1200, ...change })).toBe(said);
});

test("a trace's own delay may change", async () => {
  const later = { ...PLAYING, time_ms: 1200, position_ms: 12_200, link: { ...LINK, delay_ms: 10 } };
  expect(await seen({ trace: "bus" }, PLAYING, later)).toBeNull();
});

test.each<[string, Partial<ShaperStatus>, string | null]>([
  ["stays", {}, null],
  ["has another rate", { link: { ...LINK, up_kbps: 5000 } }, CHANGED],
  ["is that of a trace which plays", PLAYING, CHANGED],
])("a constant or unshaped link that %s", async (_, change, said) => {
  for (const network of [{ link: LINK }, {}]) {
    expect(await seen(network, CONSTANT, { ...CONSTANT, ...change, time_ms: 1200 })).toBe(said);
  }
});

test("a shaper that falls silent is noticed, and a state from before the run is not", async () => {
  expect(await seen(BUS, PLAYING, { ...CONSTANT, time_ms: 900 }, PLAYING, null)).toBe("The shaper is away.");
});

test.each([
  [BUS, ["start", { trace: "bus", loop: true, delay_ms: 40 }], [17_000, 27_000, 0]],
  [{ trace: "bus", offset_s: 20 }, ["start", { trace: "bus", loop: true, delay_ms: null }], [7000, 17_000, 20_000]],
  [{ link: LINK }, ["link", LINK], []],
  [{}, ["stop"], []],
])("the network %j plays from before the run, and is given back", async (network, begun, sought) => {
  const { shaper, asked, status } = fakeShaper(PLAYING);
  const link = new RunLink(shaper, network, 3);
  await link.begin();
  await link.warmUp();
  await link.play();
  expect(asked.splice(0)).toEqual([begun, ...sought.map((position) => ["seek", position])]);
  const stop = link.watch(
    () => 500,
    () => undefined,
  );
  status.value = { ...PLAYING, time_ms: 1200, position_ms: 12_200 };
  stop();
  await link.release();
  expect(asked).toEqual([["stop"]]);
  expect(link.samples(400, 600)).toMatchObject([{ at: 100, position_ms: 12_200, delivered_kbps: 7000 }]);
  expect([link.reports(2500), link.reports(2501), link.backend]).toEqual([true, false, "netem"]);
});

test("without a shaper only an unshaped run can be made", async () => {
  expect(() => new RunLink(null, BUS, 0)).toThrow("This server has no network shaper");
  const link = new RunLink(null, {}, 0);
  await link.begin();
  await link.warmUp();
  await link.play();
  await link.release();
  expect([link.backend, link.reports(9000)]).toEqual([null, true]);
});

test("the present link has a label, or a reason against it", () => {
  const { shaper, status, connectionError } = fakeShaper(CONSTANT);
  expect(presentNetwork(null)).toEqual({ label: "unshaped" });
  connectionError.value = "The shaper is away.";
  expect(presentNetwork(shaper)).toEqual({ problem: "The shaper is away." });
  status.value = CONSTANT;
  expect(presentNetwork(shaper)).toEqual({ label: "8mbit,4mbit-up,80ms-rtt" });
  status.value = PLAYING;
  expect(presentNetwork(shaper)).toMatchObject({ problem: expect.stringMatching(/^The trace bus is playing on/) });
});

test("labels of constant links are the command's", () => {
  for (const { label, link } of labels) if (link) expect(networkLabel(link)).toBe(label);
});
