import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { type RetryOptions, retry } from "./retry";

beforeEach(() => {
  vi.useFakeTimers();
});

afterEach(() => {
  vi.useRealTimers();
});

/** Fails this often, then succeeds; counts its attempts. */
function unreliable(failures: number, options: Partial<RetryOptions> = {}) {
  const counts = { attempts: 0, reported: 0 };
  const stop = new AbortController();
  const result = retry(
    async () => {
      if (counts.attempts++ < failures) throw new TypeError(`failure ${counts.attempts}`);
      return "there";
    },
    {
      signal: stop.signal,
      minTimeout: 100,
      maxTimeout: 300,
      onFailedAttempt: () => {
        counts.reported++;
      },
      ...options,
    },
  );
  result.catch(() => undefined); // some tests look later
  return { counts, result, stop };
}

test("failures of any kind are followed by another attempt, after pauses within the limits", async () => {
  const { counts, result } = unreliable(4);
  await vi.advanceTimersByTimeAsync(99);
  expect(counts).toEqual({ attempts: 1, reported: 1 });
  await vi.advanceTimersByTimeAsync(101 + 3 * 300);
  expect(counts).toEqual({ attempts: 5, reported: 4 });
  await expect(result).resolves.toBe("there");
});

test.each([
  [{ retries: 2 }, 3],
  [{ shouldRetry: (error: unknown) => (error as Error).message !== "failure 2" }, 2],
])("with %o it ends with the last failure, after %i attempts", async (options, attempts) => {
  const { counts, result } = unreliable(9, options);
  await vi.advanceTimersByTimeAsync(2000);
  await expect(result).rejects.toThrow(`failure ${attempts}`);
  expect(counts).toEqual({ attempts, reported: attempts });
});

test("aborted, it makes no further attempt", async () => {
  const { counts, result, stop } = unreliable(9);
  await vi.advanceTimersByTimeAsync(1);
  stop.abort(new Error("left"));
  await expect(result).rejects.toThrow("left");
  await vi.advanceTimersByTimeAsync(2000);
  expect(counts.attempts).toBe(1);
});
