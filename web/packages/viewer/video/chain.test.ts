import { beforeEach, describe, expect, test } from "vitest";
import { Chain, type Link, type Outcome } from "./chain";

const PATIENCE = 100;
const key = (seq: number): Link => ({ seq, key: true, after: null });
const next = (seq: number, after: number): Link => ({ seq, key: false, after });
const numbers = ({ ready, lost }: Outcome<Link>) => ({ ready: ready.map(({ seq }) => seq), lost: seqs(lost) });
const seqs = (frames: readonly Link[]) => frames.map(({ seq }) => seq);

let chain: Chain<Link>;
const add = (frame: Link, now = 0) => numbers(chain.add(frame, now));

beforeEach(() => {
  chain = new Chain();
});

describe("frames", () => {
  test("are ready as they come, from a key frame on, whatever numbers lie between them", () => {
    expect(add(key(3))).toEqual({ ready: [3], lost: [] });
    expect(add(next(5, 3))).toEqual({ ready: [5], lost: [] });
    expect(add(next(9, 5))).toEqual({ ready: [9], lost: [] });
  });

  test("that overtook each other are ready in the order in which they were encoded", () => {
    add(key(0));
    expect(add(next(3, 2))).toEqual({ ready: [], lost: [] });
    expect(add(next(2, 1))).toEqual({ ready: [], lost: [] });
    expect(add(next(1, 0))).toEqual({ ready: [1, 2, 3], lost: [] });
  });

  test("that overtook their key frame wait for it, too", () => {
    expect(add(next(1, 0))).toEqual({ ready: [], lost: [] });
    expect(add(key(0))).toEqual({ ready: [0, 1], lost: [] });
  });

  test("of which one is missing are given up after a while, all together, and none is shown", () => {
    add(key(0));
    add(next(2, 1), 10);
    add(next(3, 2), 60);
    expect(seqs(chain.expired(10 + PATIENCE, PATIENCE))).toEqual([]);
    expect(seqs(chain.expired(11 + PATIENCE, PATIENCE))).toEqual([2, 3]);
    expect(chain.broken).toBe(true);
    expect(add(next(4, 3), 200)).toEqual({ ready: [], lost: [] });
  });

  test("of before a key frame are of no use after it", () => {
    add(key(0));
    add(next(2, 1));
    expect(add(key(5))).toEqual({ ready: [5], lost: [2] });
    expect(add(next(1, 0))).toEqual({ ready: [], lost: [1] });
    expect(add(next(6, 5))).toEqual({ ready: [6], lost: [] });
  });

  test("that the video has gone past wait for nothing, and break nothing", () => {
    add(next(2, 0)); // from before the key frame, which an earlier request asked for
    add(key(1));
    expect(add(next(3, 1))).toEqual({ ready: [3], lost: [2] });
    expect(chain.expired(2 * PATIENCE, PATIENCE)).toEqual([]);
    expect(chain.broken).toBe(false);
  });

  test("that refer to one that was withdrawn wait for nothing", () => {
    add(key(0));
    add(next(2, 1));
    expect(seqs(chain.ended(1))).toEqual([2]);
    expect(chain.broken).toBe(true);
    add(key(4));
    chain.ended(5);
    expect(add(next(6, 5))).toEqual({ ready: [], lost: [6] });
  });

  test("go on where one was withdrawn that no other refers to", () => {
    add(key(0));
    chain.ended(1);
    expect(add(next(2, 0))).toEqual({ ready: [2], lost: [] });
    expect(chain.broken).toBe(false);
  });
});

describe("a key frame", () => {
  test("is asked for at first, by one request", () => {
    expect([chain.asks(0), chain.asks(1)]).toEqual([true, false]);
    add(key(0));
    expect(chain.asks(2)).toBe(false);
  });

  test("is asked for again only once the request that did has an answer without one", () => {
    chain.asks(0);
    expect(chain.asks(1)).toBe(false);
    chain.ended(0);
    expect([chain.asks(2), chain.asks(3)]).toEqual([true, false]);
    add(next(2, 1));
    expect(chain.asks(4)).toBe(true);
  });

  test("is asked for after the decoder failed", () => {
    chain.asks(0);
    add(key(0));
    add(next(2, 1));
    expect(seqs(chain.break())).toEqual([2]);
    expect([chain.asks(3), chain.asks(4)]).toEqual([true, false]);
    expect(add(key(3))).toEqual({ ready: [3], lost: [] });
  });
});

test("whatever is lost, and in whichever order frames come, none is ready before the one that it refers to", () => {
  let state = 7;
  const random = () => {
    state = (state * 48271) % 2147483647;
    return state / 2147483647;
  };
  for (let round = 0; round < 200; round++) {
    chain = new Chain();
    let encoded: number | null = null;
    const sent: Link[] = [];
    for (let seq = 0; seq < 40; seq++) {
      if (random() < 0.2) continue; // overtaken on the server
      sent.push(encoded === null || chain.asks(seq) || random() < 0.05 ? key(seq) : next(seq, encoded));
      encoded = seq;
    }
    const kept = sent.filter(() => random() > 0.1).map((frame, i) => ({ frame, at: i + 4 * random() }));
    let last: number | null = null;
    for (const { frame, at } of kept.toSorted((a, b) => a.at - b.at)) {
      chain.expired(at, 3);
      for (const { seq, key: isKey, after } of chain.add(frame, at).ready) {
        expect(isKey || after === last).toBe(true);
        last = seq;
      }
    }
  }
});
