/** Observations for tests: a frame of a given size on a given link and server. */
import type { Observation, Way } from "#client/abr/controller";

export interface ObservationOptions {
  readonly profile?: number;
  readonly bytes?: number;
  /** Request to last byte, in milliseconds. */
  readonly response?: number;
  /** Bits per second; null while unknown. */
  readonly throughput?: number | null;
  /** Server time, all of it rendering, in milliseconds. */
  readonly server?: number;
  readonly turning?: number;
  readonly way?: Way;
  readonly at?: number;
}

export function observation(options: ObservationOptions = {}): Observation {
  const {
    profile = 3,
    bytes = 7000,
    response = 50,
    throughput = 20e6,
    server = 10,
    turning = 0,
    way = "stale",
    at = 0,
  } = options;
  const duration = throughput === null ? 0 : (bytes * 8000) / throughput;
  const arrival = {
    sentAt: at - response,
    firstByteAt: at - duration,
    lastByteAt: at,
    bytes,
    sharedBytes: bytes,
  };
  return {
    profile,
    arrival,
    server: { queue: 0, render: server, encode: 0 },
    throughput,
    inFlight: 0,
    turning,
    way,
    at,
  };
}
