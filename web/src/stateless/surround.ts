/**
 * Which side of the surround to ask for, and when. A surround is small pictures of all directions: whichever way the view turns and
 * however long the next frame takes, something is there. One side at a time is asked for, and so seldom that link and server have
 * nearly all of their time for the view. The next one is the side that is needed most: it was never seen, or taken far from where
 * the camera is by now, and the camera looks that way. Scenes stand still, so age alone makes no side worse. Pure: times come in.
 */
import { SIDES, sideView } from "../reproject/sides";
import type { View } from "../reproject/view";
import type { ScenePose } from "../view/camera";
import { rotate, subtract, type Vector3 } from "../view/vector";
import type { Rung } from "../wire/render";

/**
 * What it may take while a view is under way, and while none is: a share of the link's time and of the server's, and of the link no
 * longer at a time, in milliseconds. On a link for which its smallest picture is too much, it waits until the view rests.
 */
const BUSY = { share: 0.05, longest: 35 };
const IDLE = { share: 0.3, longest: 500 };
/** So many that were never seen are asked for at once while no view is under way, and without a pause: nothing else is as urgent. */
const TOGETHER = 2;
/** A side is taken anew once the camera is such a share of the scene's distance away. */
const REFRESH = 0.2;
/** Such a side is as urgent as one that is not there. */
const NEVER_SEEN = 4;
/** A side so far from where the camera looks, in degrees, is half as urgent as the one ahead. */
const ASIDE = 45;
/** Of two rungs, the better one if its picture takes the link no longer than this, in milliseconds, and is no larger, in pixels. */
const MOMENT = 10;
const PIXELS = 256 * 256;
/** Bits per second, while nothing is known of the link. */
const SLOW_LINK = 1e6;
/** After a failure, in milliseconds; longer while a view is under way. */
const RETRY_AFTER = 500;
const DEGREES = 180 / Math.PI;

/** One to ask for. */
export interface WantedSide {
  readonly side: number;
  readonly view: View;
  readonly profile: number;
}

/** What the next side follows from. */
export interface Surroundings {
  readonly now: number;
  /** Where the camera is expected to be when what is asked for now comes. */
  readonly pose: ScenePose;
  /** The sides that there are, by number. */
  readonly there: ReadonlyMap<number, View>;
  /** No view is under way. */
  readonly idle: boolean;
  /** Of the link, in bits per second; null while unknown. */
  readonly throughput: number | null;
  /** The best rung first. */
  readonly ladder: readonly Rung[];
}

export class Surround {
  readonly #distance: number;
  readonly #up: Vector3;
  readonly #pending = new Set<number>();
  /** The last one did not come. */
  #failed = false;
  /** When the last one was asked for, and how long it kept the link or the server. */
  #askedAt = Number.NEGATIVE_INFINITY;
  #took = 0;

  /** `distance`: how far away most of the scene is, in its units; `up`: in its frame. */
  constructor(distance: number, up: Vector3) {
    this.#distance = distance;
    this.#up = up;
  }

  /** The side to ask for now, if any; then `came` or `failed` is called for it. */
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

  /** Whether sides that were never seen come now, so that a view that rests gets no sharper before. */
  hurries({ there, throughput, ladder }: Pick<Surroundings, "there" | "throughput" | "ladder">): boolean {
    const affordable = rungFor(ladder, throughput ?? SLOW_LINK, IDLE.longest) !== null;
    return affordable && !this.#failed && SIDES.some((side) => !there.has(side));
  }

  /** A side came, in so many bytes, and took the server so many milliseconds. */
  came(side: number, bytes: number, server: number, throughput: number | null): void {
    this.#pending.delete(side);
    this.#failed = false;
    this.#took = Math.max(server, (bytes * 8000) / (throughput ?? SLOW_LINK));
  }

  /** It will not come. */
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

/** The best one that is small and quick on this link, or else the last one; null if that takes too long, in milliseconds. */
function rungFor(ladder: readonly Rung[], throughput: number, longest: number): number | null {
  const takes = ({ expected_kb }: Rung) => (expected_kb * 8e6) / throughput;
  const best = ladder.findIndex((rung) => rung.width * rung.height <= PIXELS && takes(rung) <= MOMENT);
  const last = ladder.at(-1);
  if (best >= 0) return best;
  return last && takes(last) <= longest ? ladder.length - 1 : null;
}

/** Of two directions of length 1, in degrees. */
function angleTo(a: Vector3, b: Vector3): number {
  return Math.acos(Math.min(1, Math.max(-1, a[0] * b[0] + a[1] * b[1] + a[2] * b[2]))) * DEGREES;
}
