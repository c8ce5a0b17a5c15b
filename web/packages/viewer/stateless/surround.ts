/**
 * Schedules the sides of the surround: small pictures of all directions, so that some picture exists wherever the view
 * turns and however long the next frame takes. One side at a time is requested, rarely enough to leave nearly all of
 * the link and server to the view. The next side is the most urgent one: never seen, or taken far from the present
 * position, and in the direction of view. Scenes are static, so age alone makes no side worse. Pure: time is an
 * argument.
 */

import type { Rung } from "#client/wire/render";
import { SIDES, sideView } from "../reproject/side-pictures";
import type { View } from "../reproject/view";
import type { ScenePose } from "../view/camera";
import { rotate, subtract, type Vector3 } from "../view/vector";

/**
 * Budget while a view is in flight, and while none is: a share of the link's and of the server's time, and the longest
 * time on the link per picture in milliseconds. If even the smallest picture exceeds it, the surround waits until the
 * view rests.
 */
const BUSY = { share: 0.05, longest: 35 };
const IDLE = { share: 0.3, longest: 500 };
/**
 * This many unseen sides are requested at once, without pauses, while no view is in flight: nothing else is as urgent.
 */
const TOGETHER = 2;
/** A side is requested again once the camera is this share of the scene's distance away. */
const REFRESH = 0.2;
/** Urgency of a missing side, and of such a side. */
const NEVER_SEEN = 4;
/** A side this far from the viewing direction, in degrees, is half as urgent as the one ahead. */
const ASIDE = 45;
/** Limits for choosing the better of two rungs: its picture's time on the link, in milliseconds, and its size, in pixels. */
const MOMENT = 10;
const PIXELS = 256 * 256;
/** Assumed bits per second while the link is unknown. */
const SLOW_LINK = 1e6;
/** Pause after a failure, in milliseconds; longer while a view is in flight. */
const RETRY_AFTER = 500;
const DEGREES = 180 / Math.PI;

export interface WantedSide {
  readonly side: number;
  readonly view: View;
  readonly profile: number;
}

export interface Surroundings {
  readonly now: number;
  /** Predicted camera position at the time of the answer. */
  readonly pose: ScenePose;
  /** The available sides, by number. */
  readonly there: ReadonlyMap<number, View>;
  /** Whether no view is in flight. */
  readonly idle: boolean;
  /** Throughput of the link in bits per second; null while unknown. */
  readonly throughput: number | null;
  readonly ladder: readonly Rung[];
}

export class Surround {
  readonly #distance: number;
  readonly #up: Vector3;
  readonly #pending = new Set<number>();
  /** Whether the last request failed. */
  #failed = false;
  /** Time of the last request, and how long it occupied the link or the server. */
  #askedAt = Number.NEGATIVE_INFINITY;
  #took = 0;

  /** `distance` is how far away most of the scene is, in its units; `up` is in its frame. */
  constructor(distance: number, up: Vector3) {
    this.#distance = distance;
    this.#up = up;
  }

  /** The side to request now, if any; the caller then reports `came` or `failed`. */
  next(surroundings: Surroundings): WantedSide | null {
    const { now, pose, there, idle, throughput, ladder } = surroundings;
    const { share, longest } = idle ? IDLE : BUSY;
    const hurry = idle && !this.#failed && SIDES.some((side) => !there.has(side) && !this.#pending.has(side));
    const paused = this.#pending.size > 0 || now < this.#askedAt + this.#took / share;
    if (hurry ? this.#pending.size >= TOGETHER : paused) return null;
    const profile = rungFor(ladder, throughput ?? SLOW_LINK, longest);
    if (profile === null) return null;
    const side = this.#mostNeeded(surroundings);
    if (side === undefined) return null;
    this.#pending.add(side);
    this.#askedAt = now;
    return { side, view: sideView(side, pose.position, this.#up), profile };
  }

  hurries({ there, throughput, ladder }: Pick<Surroundings, "there" | "throughput" | "ladder">): boolean {
    const affordable = rungFor(ladder, throughput ?? SLOW_LINK, IDLE.longest) !== null;
    return affordable && !this.#failed && SIDES.some((side) => !there.has(side));
  }

  came(side: number, bytes: number, server: number, throughput: number | null): void {
    this.#pending.delete(side);
    this.#failed = false;
    this.#took = Math.max(server, (bytes * 8000) / (throughput ?? SLOW_LINK));
  }

  failed(side: number): void {
    this.#pending.delete(side);
    this.#failed = true;
    this.#took = RETRY_AFTER * IDLE.share;
  }

  #mostNeeded({ pose, there }: Surroundings): number | undefined {
    const urgencies = SIDES.map((side) => {
      if (this.#pending.has(side)) return 0;
      const known = there.get(side);
      const moved = known && Math.hypot(...subtract(pose.position, known.position)) / this.#distance / REFRESH;
      if (moved !== undefined && moved < 1) return 0;
      const ahead = rotate(pose.quaternion, [0, 0, 1]);
      const angle = angleTo(ahead, rotate(sideView(side, pose.position, this.#up).quaternion, [0, 0, 1]));
      return (moved === undefined ? NEVER_SEEN : Math.min(moved, NEVER_SEEN)) / (1 + (angle / ASIDE) ** 2);
    });
    const most = Math.max(...urgencies);
    return most > 0 ? urgencies.indexOf(most) : undefined;
  }
}

/**
 * The best rung that is small and fast on this link, or else the last one; null if that exceeds the limit, in
 * milliseconds.
 */
function rungFor(ladder: readonly Rung[], throughput: number, longest: number): number | null {
  const takes = ({ expected_kb }: Rung) => (expected_kb * 8e6) / throughput;
  const best = ladder.findIndex((rung) => rung.width * rung.height <= PIXELS && takes(rung) <= MOMENT);
  const last = ladder.at(-1);
  if (best >= 0) return best;
  return last && takes(last) <= longest ? ladder.length - 1 : null;
}

/** Angle between two directions of length 1, in degrees. */
function angleTo(a: Vector3, b: Vector3): number {
  return Math.acos(Math.min(1, Math.max(-1, a[0] * b[0] + a[1] * b[1] + a[2] * b[2]))) * DEGREES;
}
