/** Retries after failures, with growing, random pauses. */

/** Waits for this many milliseconds; rejects with the signal's reason if aborted. */
export function sleep(milliseconds: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    signal.throwIfAborted();
    const abort = () => {
      clearTimeout(timer);
      reject(signal.reason);
    };
    const timer = setTimeout(() => {
      signal.removeEventListener("abort", abort);
      resolve();
    }, milliseconds);
    signal.addEventListener("abort", abort, { once: true });
  });
}

export interface RetryOptions {
  readonly signal: AbortSignal;
  /** Attempts after the first; by default unlimited. */
  readonly retries?: number;
  /** First and longest pause, in milliseconds. */
  readonly minTimeout?: number;
  readonly maxTimeout?: number;
  /** Ratio of a pause to the previous one; each is up to twice as long, at random. */
  readonly factor?: number;
  readonly onFailedAttempt?: (error: unknown) => void;
  /** Whether another attempt may help; by default always. */
  readonly shouldRetry?: (error: unknown) => boolean;
}

/** Resolves with the first success. Rejects with the last failure, or with the signal's reason. */
export async function retry<T>(
  attempt: () => Promise<T>,
  {
    signal,
    retries = Number.POSITIVE_INFINITY,
    minTimeout = 1000,
    maxTimeout = Number.POSITIVE_INFINITY,
    factor = 2,
    onFailedAttempt = () => undefined,
    shouldRetry = () => true,
  }: RetryOptions,
): Promise<T> {
  for (let failures = 0; ; failures++) {
    signal.throwIfAborted();
    try {
      return await attempt();
    } catch (error) {
      signal.throwIfAborted();
      onFailedAttempt(error);
      if (failures >= retries || !shouldRetry(error)) throw error;
    }
    await sleep(Math.min(maxTimeout, minTimeout * factor ** failures * (1 + Math.random())), signal);
  }
}
