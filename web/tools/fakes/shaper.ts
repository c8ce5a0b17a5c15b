/** Reports of a shaper for tests: of a constant link, and of a trace that plays. */
import type { ShaperStatus } from "#client/wire/shaper";

export const LINK = { down_kbps: 8000, up_kbps: 4000, delay_ms: 40, jitter_ms: 0, loss_pct: 0 };
const DIRECTION = { target_kbps: 8000, delivered_kbps: 7000, queue_bytes: 0, queue_ms: 0, drops: 0 };

export const CONSTANT: ShaperStatus = {
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

export const PLAYING: ShaperStatus = {
  ...CONSTANT,
  mode: "playing",
  trace: "bus",
  position_ms: 12_000,
  duration_ms: 30_000,
  loop: true,
};
