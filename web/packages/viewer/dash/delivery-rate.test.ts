import { beforeEach, expect, test } from "vitest";
import { affordable, DeliveryRate } from "./delivery-rate";

type Offer = { readonly bandwidth: number };

let rate: DeliveryRate;

beforeEach(() => {
  rate = new DeliveryRate();
  rate.begin();
});

/** A box of this many bytes, header included. */
function box(type: string, size: number): number[] {
  const header = [size >>> 24, (size >>> 16) & 255, (size >>> 8) & 255, size & 255];
  return [...header, ...new TextEncoder().encode(type), ...new Array<number>(size - 8).fill(7)];
}

/** A chunk of this many bytes. */
function chunk(size: number): Uint8Array {
  return Uint8Array.from([...box("styp", 16), ...box("moof", 84), ...box("mdat", size - 100)]);
}

/** A chunk arrives bit by bit. */
function receive(bytes: Uint8Array, at: number, step: number, every: number): void {
  for (let from = 0; from < bytes.length; from += step) {
    rate.received(bytes.subarray(from, from + step), at + (from / step) * every);
  }
}

test("a chunk's bytes by the time that they took are the link's rate, however long the next one is waited for", () => {
  for (let at = 0; at < 1000; at += 100) receive(chunk(5000), at, 1000, 2);
  expect(rate.bitsPerSecond(1000)).toBe(4_000_000); // 1000 bytes each 2 ms
});

test("boxes are told apart wherever the bytes are cut", () => {
  const two = Uint8Array.from([...chunk(500), ...chunk(500)]);
  receive(two, 0, 7, 1);
  expect(rate.bitsPerSecond(200)).toBeCloseTo(56_000, -3); // 7 bytes each millisecond
});

test("a chunk that is there at once is faster than can be measured; a page that was busy for once changes nothing", () => {
  expect(rate.bitsPerSecond(0)).toBeNull();
  for (let at = 0; at < 10; at++) rate.received(chunk(5000), at);
  receive(chunk(5000), 20, 2500, 40);
  expect(rate.bitsPerSecond(60)).toBe(Number.POSITIVE_INFINITY);
});

test("what was measured is forgotten, and a segment that broke off does not count", () => {
  receive(chunk(5000), 0, 1000, 2);
  expect(rate.bitsPerSecond(2000)).toBeNull();
  rate.received(chunk(5000).subarray(0, 3000), 2000);
  rate.begin();
  receive(chunk(5000), 2500, 1000, 2);
  expect(rate.bitsPerSecond(2600)).toBe(4_000_000);
});

test("the best that leaves a fifth of the rate is taken, and the lowest where nothing is known or nothing fits", () => {
  const offered = [500, 1400, 4200].map((bandwidth) => ({ bandwidth })) as [Offer, Offer, Offer];
  const taken = [null, 100, 1800, 5200, 5300, Number.POSITIVE_INFINITY].map((each) => affordable(offered, each));
  expect(taken.map(({ bandwidth }) => bandwidth)).toEqual([500, 500, 1400, 1400, 4200, 4200]);
});
