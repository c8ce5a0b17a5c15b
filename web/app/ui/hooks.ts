/** Hooks shared by pages and panels. */
import { type ReadonlySignal, useSignal } from "@preact/signals";
import { useCallback, useEffect, useRef } from "preact/hooks";
import { refreshScenes } from "../state/app";

/** Calls the newest `listener` with the window's events. */
export function useWindowEvent<Type extends keyof WindowEventMap>(
  type: Type,
  listener: (event: WindowEventMap[Type]) => void,
): void {
  const newest = useRef(listener);
  newest.current = listener;
  useEffect(() => {
    const listening = new AbortController();
    addEventListener(type, (event) => newest.current(event), { signal: listening.signal });
    return () => listening.abort();
  }, [type]);
}

/** Makes the browser confirm leaving the page while unsaved work would be lost. */
export function useLeavingWarning(needed: boolean): void {
  useWindowEvent("beforeunload", (event) => needed && event.preventDefault());
}

/** The window is wide enough for a sidebar next to the stage, which excludes phones in landscape. */
export const WIDE = "(min-width: 800px) and (min-height: 500px)";
export const TOUCH = "(pointer: coarse)";

/** Whether a media query currently matches. */
export function useMedia(condition: string): boolean {
  const matches = useSignal(matchMedia(condition).matches);
  useEffect(() => {
    const query = matchMedia(condition);
    const follow = () => {
      matches.value = query.matches;
    };
    query.addEventListener("change", follow);
    return () => query.removeEventListener("change", follow);
  }, [condition, matches]);
  return matches.value;
}

interface Attempts {
  readonly busy: ReadonlySignal<boolean>;
  /** Why the last attempt failed, in one sentence; null otherwise. */
  readonly problem: ReadonlySignal<string | null>;
  /** Resolves with whether it succeeded. */
  readonly attempt: (action: () => unknown) => Promise<boolean>;
}

/** Runs actions that may fail. */
export function useAttempts(): Attempts {
  const busy = useSignal(false);
  const problem = useSignal<string | null>(null);
  const attempt = useCallback(
    async (action: () => unknown) => {
      busy.value = true;
      try {
        await action();
        problem.value = null;
        return true;
      } catch (error) {
        problem.value = reason(error);
        return false;
      } finally {
        busy.value = false;
      }
    },
    [busy, problem],
  );
  return { busy, problem, attempt };
}

/** The reason for a failure, in one sentence. */
export function reason(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

/** Sets the title of the browser's tab, and fetches the server's configuration and scenes. */
export function usePage(title: string): void {
  useEffect(() => {
    document.title = `${title} · TIGAS`;
    void refreshScenes();
  }, [title]);
}
