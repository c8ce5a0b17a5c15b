/** `AbortSignal.any` for Safari before 17.4, which lacks it. */

AbortSignal.any ??= anyOf;

/** A signal that aborts with the first of `signals`, for the same reason. */
export function anyOf(signals: Iterable<AbortSignal>): AbortSignal {
  const either = new AbortController();
  for (const signal of signals) {
    if (signal.aborted) either.abort(signal.reason);
    else signal.addEventListener("abort", () => either.abort(signal.reason), { signal: either.signal });
  }
  return either.signal;
}
