import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { FakeTransport, turn } from "#fakes/transport";
import { deferred } from "../async/deferred";
import { sleep } from "../async/retry";
import type { ServerConfig } from "../wire/render";
import { type ConnectionState, maintainConnection } from "./connection";
import { ASK_DIRECTOR_EVERY, CHECK_EVERY, LOOK_ELSEWHERE_EVERY, LOOK_EVERY } from "./ending";
import type { HostReport } from "./host-report";
import { RequestProblem } from "./transport";

/** Attempts are repeated at once. */
vi.mock("../async/retry", async (original) => {
  const { retry } = await original<typeof import("../async/retry")>();
  const soon: typeof retry = (attempt, options) => retry(attempt, { ...options, minTimeout: 1, maxTimeout: 2 });
  return { retry: soon, sleep: vi.fn() };
});

/** After a connection was lost, in milliseconds. */
const PAUSE = 300;
const UNKNOWN_SCENE = { type: "tigas:unknown-scene", title: "", status: 404, detail: "" };

const config = (certificate: string): ServerConfig => ({
  version: "1",
  ladder: [],
  certificate_sha256: certificate,
  webtransport_url: null,
  https_url: null,
  services: {},
});

let certificate: string;
let reachable: boolean;
/** The server's "full" answers, in order; afterwards it has room. */
let full: (number | null)[];
let fallback: string | null;
/** The host named by the director, if any, and the reports sent to it. */
let named: string | null;
let reports: (HostReport | undefined)[];
/** By host: unreachable hosts, and the director's answer once they are reported as lost. */
let instead: Map<string, string>;
/** Waiting times in milliseconds, except between checks. */
let waits: number[];
let transports: FakeTransport[];
let states: ConnectionState[];
let checks: (() => void)[];
let looks: (() => void)[];
let silence: boolean[];
let now: number;
/** Settles when the server's configuration arrives. */
let reply: () => Promise<void>;
let visible: () => Promise<void>;
let stop: AbortController;
let running: Promise<void>;

/** Waits until the connection has been in this state this often. */
const reached = (status: ConnectionState["status"], times = 1) =>
  vi.waitFor(() => expect(states.filter((state) => state.status === status).length).toBeGreaterThanOrEqual(times), {
    interval: 1,
  });

function start(): void {
  running = maintainConnection(
    {
      fetchConfig: async (_, report) => {
        reports.push(report);
        await reply();
        if (!reachable) throw new Error("The server is not responding.");
        if (report && "lost" in report) named = instead.get(report.lost) ?? named;
        return { ...config(certificate), retry_after_s: full.shift() ?? null, host: named };
      },
      connect: async ({ host = null }) => {
        const transport = new FakeTransport(() => now);
        transports.push(transport);
        const refused = instead.has(host ?? "");
        return { transport, fallback: refused ? "QUIC could not connect" : fallback, host, refused };
      },
      onState: (state) => states.push(state),
      onSilence: (silent) => silence.push(silent),
      now: () => now,
      visible: () => visible(),
    },
    stop.signal,
  );
}

async function wait(milliseconds: number, signal: AbortSignal): Promise<void> {
  const checking = [CHECK_EVERY, ASK_DIRECTOR_EVERY].includes(milliseconds);
  if (!checking && ![LOOK_EVERY, LOOK_ELSEWHERE_EVERY].includes(milliseconds)) waits.push(milliseconds);
  if (milliseconds === PAUSE || full.length > 0) return;
  const { promise, resolve, reject } = deferred<void>();
  signal.addEventListener("abort", () => reject(signal.reason));
  (checking ? checks : looks).push(() => resolve());
  await promise;
}

/** Connects for the first time. */
async function connected(): Promise<void> {
  start();
  await reached("connected");
}

/** Waits until this many checks of the server are due in all. */
const checked = (times: number) => vi.waitFor(() => expect(checks).toHaveLength(times));

beforeEach(() => {
  certificate = "a";
  reachable = true;
  full = [];
  fallback = null;
  named = null;
  reports = [];
  instead = new Map();
  waits = [];
  transports = [];
  states = [];
  checks = [];
  looks = [];
  silence = [];
  now = 0;
  reply = async () => undefined;
  visible = async () => undefined;
  stop = new AbortController();
  vi.mocked(sleep).mockImplementation(wait);
  vi.spyOn(Math, "random").mockReturnValue(0.5);
});

afterEach(async () => {
  stop.abort();
  await running;
  expect(transports.every(({ closed }) => closed)).toBe(true);
});

test("connects, and closes the transport when it is stopped", async () => {
  await connected();
  stop.abort(new Error("left the page"));
  await running;
  expect(states.map(({ status }) => status)).toEqual(["connecting", "connected"]);
  expect(transports[0]?.closed).toBe(true);
});

test("a lost transport is replaced", async () => {
  await connected();
  transports[0]?.lose("The connection to the server was lost.");
  await reached("connected", 2);
  expect(states[2]).toEqual({ status: "lost", reason: "The connection to the server was lost." });
  expect(transports.map(({ closed }) => closed)).toEqual([true, false]);
});

test("a server that is not there is tried again until it is", async () => {
  reachable = false;
  start();
  await reached("lost", 3);
  reachable = true;
  await reached("connected");
});

test("a full server is asked again when it says, a little later, until it has room", async () => {
  full = [5, 3, null];
  await connected();
  expect(states.map(({ status }) => status)).toEqual(["connecting", "full", "full", "connected"]);
  expect(waits).toEqual([6250, 3750]);
  expect(transports).toHaveLength(1);
});

test("a server that has become full while it was connected to is full, and not without QUIC", async () => {
  full = [null, 2, null];
  fallback = "QUIC could not connect";
  await connected();
  expect(states.map(({ status }) => status)).toEqual(["connecting", "full", "connected"]);
  expect(transports.map(({ closed }) => closed)).toEqual([true, false]);
});

test("a server that died in silence is noticed", async () => {
  await connected();
  await checked(1);
  reachable = false;
  checks[0]?.();
  await reached("lost");
  expect(transports[0]?.closed).toBe(true);
});

test("a malformed configuration is no reason to give up", async () => {
  let malformed = true;
  reply = async () => {
    if (malformed) throw new TypeError("Cannot read properties of null");
  };
  start();
  await reached("lost", 3);
  malformed = false;
  await reached("connected");
});

test("a hidden page asks the server for nothing until it is shown", async () => {
  const shown = deferred<void>();
  await connected();
  await checked(1);
  const before = reports.length;
  visible = () => shown.promise;
  checks[0]?.();
  transports[0]?.lose("the session ended");
  await reached("lost");
  for (let turn = 0; turn < 20; turn++) await new Promise((resolve) => setTimeout(resolve));
  expect(reports).toHaveLength(before);
  shown.resolve();
  await reached("connected", 2);
});

test("a server that was started again is noticed by its certificate", async () => {
  await connected();
  await checked(1);
  checks[0]?.(); // nothing new: the connection stays
  await checked(2);
  expect(transports).toHaveLength(1);
  certificate = "b";
  checks[1]?.();
  await reached("connected", 2);
  expect(states[2]).toEqual({ status: "lost", reason: "The server was restarted." });
});

const request = { scene: "s", seq: 0, fx: 1, fy: 1, cx: 1, cy: 1, width: 2, height: 2 };
const never = new AbortController().signal;

/** Advances the time and settles everything that follows. */
async function pass(milliseconds: number): Promise<void> {
  for (const end = now + milliseconds; now < end; now += LOOK_EVERY) {
    for (const look of looks.splice(0)) look();
    await turn();
  }
}

/** Connects, requests a view, and waits in vain for long enough. */
async function fallSilent(): Promise<void> {
  await connected();
  const state = states.find((state) => state.status === "connected");
  state?.transport.request(request, never).catch(() => undefined);
  await turn();
}

describe("a server that has fallen silent", () => {
  const probes = () => (transports[0]?.requests.length ?? 0) - 1;

  test("is asked again, over the connection and beside it, and a restart is noticed at once", async () => {
    await fallSilent();
    await pass(1500);
    expect([silence, probes()]).toEqual([[], 0]);
    certificate = "b";
    await pass(1000);
    expect(silence[0]).toBe(true);
    await reached("connected", 2);
    expect(states[2]).toEqual({ status: "lost", reason: "The server was restarted." });
    expect(silence.at(-1)).toBe(false);
    expect(transports.map(({ closed }) => closed)).toEqual([true, false]);
  });

  test("but can be reached has lost the connection", async () => {
    await fallSilent();
    await pass(5000);
    expect(transports).toHaveLength(1);
    await pass(3000);
    await reached("connected", 2);
    expect(states[2]).toEqual({ status: "lost", reason: "The connection stopped responding." });
  });

  test("and refuses what it is asked then is only slow", async () => {
    await fallSilent();
    for (let i = 0; i < 20; i++) {
      await pass(1000);
      for (const { fail } of transports[0]?.requests.slice(1) ?? []) fail(new RequestProblem(UNKNOWN_SCENE));
    }
    expect(transports).toHaveLength(1);
    expect(states).toHaveLength(2);
    expect(silence).toContain(false);
  });

  test("for as long as the network is out keeps its connection", async () => {
    const { promise: backAgain, resolve: comeBack } = deferred<void>();
    await fallSilent();
    reply = () => backAgain;
    await pass(20_000);
    expect(probes()).toBeGreaterThan(0);
    comeBack();
    await turn();
    for (const { reply } of transports[0]?.requests ?? []) reply();
    await pass(10_000);
    expect(states).toHaveLength(2);
    expect(silence.at(-1)).toBe(false);
  });
});

describe("in a cluster", () => {
  /** The connected hosts in order; no other state may have been reported. */
  const hosts = () =>
    states.slice(1).map((state) => (state.status === "connected" ? state.host : `${state.status} instead`));

  beforeEach(() => {
    named = "a";
  });

  test("a viewer goes where it is sent, and what it sees stays open until it is there", async () => {
    await connected();
    await checked(1);
    checks[0]?.(); // it may stay
    await checked(2);
    expect(hosts()).toEqual(["a"]);
    named = "b";
    checks[1]?.();
    await reached("connected", 2);
    expect(hosts()).toEqual(["a", "b"]);
    expect(reports).toEqual([undefined, { at: "a" }, { at: "a" }]);
    expect(transports.map(({ closed }) => closed)).toEqual([true, false]);
  });

  test("a host that has been silent for a moment is left for another", async () => {
    await fallSilent();
    named = "b";
    await pass(500);
    expect(reports).toHaveLength(1);
    await pass(500);
    await reached("connected", 2);
    expect(hosts()).toEqual(["a", "b"]);
    expect(reports[1]).toEqual({ silent: "a" });
  });

  test("a silent host that its director still hears keeps its viewer, and is asked about again", async () => {
    await fallSilent();
    await pass(2000);
    expect(hosts()).toEqual(["a"]);
    named = "b";
    await pass(1250);
    expect(hosts()).toEqual(["a", "b"]);
  });

  test("a session that has ended is replaced at once, wherever its viewer is sent", async () => {
    await connected();
    now += 5000;
    named = "b";
    transports[0]?.lose("The connection to the server was lost.");
    await reached("connected", 2);
    expect(hosts()).toEqual(["a", "b"]);
    expect(reports[1]).toEqual({ silent: "a" });
    expect(waits).toEqual([]);
  });

  test("while the director is away, a session that has ended is opened again at the same host", async () => {
    await connected();
    now += 5000;
    reachable = false;
    transports[0]?.lose("The connection to the server was lost.");
    await reached("connected", 2);
    expect(hosts()).toEqual(["a", "a"]);
    now += 5000;
    instead = new Map([["a", "b"]]);
    transports[1]?.lose("The connection to the server was lost.");
    await reached("lost");
    reachable = true;
    await reached("connected", 3);
    expect(hosts().at(-1)).toBe("b");
  });

  test("a session that ends as soon as it has begun is not opened again at once", async () => {
    await connected();
    transports[0]?.lose("The connection to the server was lost.");
    await reached("connected", 2);
    expect(hosts()).toEqual(["a", "lost instead", "a"]);
    expect(waits).toEqual([PAUSE]);
  });

  test("a host that cannot be got into is told of, and another one entered", async () => {
    instead = new Map([["a", "b"]]);
    await connected();
    expect(hosts()).toEqual(["b"]);
    expect(reports).toEqual([undefined, { lost: "a" }]);
    expect(transports.map(({ closed }) => closed)).toEqual([true, false]);
  });

  test("a browser without WebTransport stays with the host that it is sent to", async () => {
    fallback = "this browser has no WebTransport";
    await connected();
    expect(reports).toEqual([undefined, { at: "a" }]);
    expect(hosts()).toEqual(["a"]);
  });

  test("where QUIC reaches no host, each is tried once", async () => {
    instead = new Map([
      ["a", "b"],
      ["b", "a"],
    ]);
    await connected();
    expect(hosts()).toEqual(["b"]);
    expect(transports).toHaveLength(2);
  });

  test("nobody leaves for a host that is full, or because the director is away", async () => {
    await connected();
    await checked(1);
    [named, full] = ["b", [5]];
    checks[0]?.();
    await vi.waitFor(() => expect(reports).toHaveLength(2));
    await turn();
    [named, reachable] = ["a", false];
    for (const check of checks.splice(0)) check();
    await vi.waitFor(() => expect(reports).toHaveLength(3));
    await turn();
    expect(hosts()).toEqual(["a"]);
  });
});

test("stopping ends the attempts", async () => {
  reachable = false;
  start();
  await reached("lost");
  stop.abort(new Error("left the page"));
  await running;
  const attempts = states.length;
  await new Promise((resolve) => setTimeout(resolve, 10));
  expect(states).toHaveLength(attempts);
});
