import { expect, test } from "vitest";
import { RateCap } from "./rate-cap";

/**
 * Bytes of frames of these sizes in turn, received `delay` animation frames after their requests, over this many
 * seconds.
 */
function received(
  kbps: number | null,
  sizes: readonly number[],
  delay = 0,
  seconds = 20,
): { bytes: number; gap: number } {
  const cap = new RateCap();
  const coming: number[] = [];
  let [bytes, asked, last, gap] = [0, 0, 0, 0];
  for (let frame = 0; frame < seconds * 60; frame++) {
    const now = (frame * 1000) / 60;
    if (coming[0] !== undefined && coming[0] <= frame) {
      coming.shift();
      const size = sizes[asked++ % sizes.length] ?? 0;
      cap.came(size);
      bytes += size;
    }
    if (!cap.allows(kbps, now)) continue;
    if (now > 2000) gap = Math.max(gap, now - last);
    last = now;
    cap.asked();
    coming.push(frame + delay);
  }
  return { bytes, gap };
}

test.each([
  [1000, [20_000], 0],
  [1000, [20_000], 12],
  [1000, [5_000, 35_000], 12],
  [4000, [20_000], 30],
])("%d kbit/s are kept to and made use of with frames of %j bytes after %d animation frames", (kbps, sizes, delay) => {
  const { bytes } = received(kbps, sizes, delay);
  expect((bytes * 8) / 20_000 / kbps).toBeGreaterThan(0.92);
  expect((bytes * 8) / 20_000 / kbps).toBeLessThan(1.05);
});

test("frames are spread evenly: one of 20 kB each 160 ms at 1 Mbit/s", () => {
  expect(received(1000, [20_000], 12).gap).toBeLessThan(200);
});

test("without a cap each animation frame may ask, also when the cap is lifted", () => {
  expect(received(null, [20_000]).bytes).toBeGreaterThan(59 * 20 * 20_000);
  const cap = new RateCap();
  cap.besides(1_000_000);
  expect([cap.allows(100, 0), cap.allows(null, 1), cap.allows(100, 2)]).toEqual([false, true, true]);
});
