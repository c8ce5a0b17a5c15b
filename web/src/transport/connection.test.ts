import { beforeEach, expect, test, vi } from "vitest";
import { deferred } from "../async/deferred";
import type { ServerConfig } from "../wire/render";
import { type ConnectionState, maintainConnection } from "./connection";
import { FakeTransport } from "./fake";

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
let transports: FakeTransport[];
let states: ConnectionState[];
let checks: (() => void)[];
let stop: AbortController;

/** Waits until the connection has been in this state so often. */
const reached = (status: ConnectionState["status"], times = 1) =>
  vi.waitFor(() => expect(states.filter((state) => state.status === status).length).toBeGreaterThanOrEqual(times), {
    interval: 1,
  });

function start(): Promise<void> {
  return maintainConnection(
    {
      fetchConfig: async () => {
        if (!reachable) throw new Error("The server does not answer.");
        return config(certificate);
      },
      connect: async () => {
        const transport = new FakeTransport(() => 0);
        transports.push(transport);
        return { transport, fallback: null };
      },
      onState: (state) => states.push(state),
      sleep: async (milliseconds, signal) => {
        if (milliseconds < 100) return;
        const { promise, resolve, reject } = deferred<void>();
        signal.addEventListener("abort", () => reject(signal.reason));
        checks.push(() => resolve());
        await promise;
      },
      retry: { minTimeout: 1, maxTimeout: 2 },
    },
    stop.signal,
  );
}

beforeEach(() => {
  certificate = "a";
  reachable = true;
  transports = [];
  states = [];
  checks = [];
  stop = new AbortController();
});

test("connects, and closes the transport when it is stopped", async () => {
  const running = start();
  await reached("connected");
  stop.abort(new Error("left the page"));
  await running;
  expect(states.map(({ status }) => status)).toEqual(["connecting", "connected"]);
  expect(transports[0]?.closed).toBe(true);
});

test("a lost transport is replaced", async () => {
  const running = start();
  await reached("connected");
  transports[0]?.lose("The connection to the server broke.");
  await reached("connected", 2);
  expect(states[2]).toEqual({ status: "lost", reason: "The connection to the server broke." });
  expect(transports.map(({ closed }) => closed)).toEqual([true, false]);
  stop.abort();
  await running;
});

test("a server that is not there is tried again until it is", async () => {
  reachable = false;
  const running = start();
  await reached("lost", 3);
  reachable = true;
  await reached("connected");
  stop.abort();
  await running;
});

test("a server that died in silence is noticed", async () => {
  const running = start();
  await reached("connected");
  await vi.waitFor(() => expect(checks).toHaveLength(1));
  reachable = false;
  checks[0]?.();
  await reached("lost");
  expect(transports[0]?.closed).toBe(true);
  stop.abort();
  await running;
});

test("a server that was started again is noticed by its certificate", async () => {
  const running = start();
  await reached("connected");
  await vi.waitFor(() => expect(checks).toHaveLength(1));
  checks[0]?.(); // nothing new: the connection stays
  await vi.waitFor(() => expect(checks).toHaveLength(2));
  expect(transports).toHaveLength(1);
  certificate = "b";
  checks[1]?.();
  await reached("connected", 2);
  expect(states[2]).toEqual({ status: "lost", reason: "The server was started again." });
  stop.abort();
  await running;
});

test("stopping ends the attempts", async () => {
  reachable = false;
  const running = start();
  await reached("lost");
  stop.abort(new Error("left the page"));
  await running;
  const attempts = states.length;
  await new Promise((resolve) => setTimeout(resolve, 10));
  expect(states).toHaveLength(attempts);
});
