/** Bottlenecks other than the link: the renderer or encoder, or this computer. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { SessionStatus } from "#client/wire/dash";
import type { ViewerSession } from "#viewer/session/session";
import type { Side } from "#viewer/session/side";
import type { Source } from "#viewer/sources/source";
import { MANY_REPEATS, repeatedShare } from "#viewer/stream/packager";
import type { Presence } from "#viewer/view/presence";
import type { Rig } from "#viewer/view/rig";
import { type Said, serverNote } from "./notes";

/** Polling interval of the packager's status, in milliseconds. */
const ASK_EVERY = 2000;
/** How often drawn pictures are counted, in milliseconds. */
const COUNT_EVERY = 2000;
/** With fewer a second, no mode can look smooth here. */
const FEW_PICTURES = 30;

export function useLimits(side: Side, { rig, presence }: Pick<ViewerSession, "rig" | "presence">): Said {
  const drawn = useDrawn(rig, presence);
  const repeated = useRepeats(side.source.value, presence);
  const { figures } = side;
  return {
    "server-note": figures?.kind === "requests" ? serverNote(figures) : streamNote(repeated),
    "browser-note": browserNote(drawn),
  };
}

function streamNote(repeated: number | null): string | null {
  if (repeated === null || repeated <= MANY_REPEATS) return null;
  return `The server is slow, not your connection: ${Math.round(repeated * 100)} % of the stream’s frames show nothing new.`;
}

function browserNote(drawn: number | null): string | null {
  if (drawn === null || drawn >= FEW_PICTURES) return null;
  const pictures = Math.round(drawn);
  return `This computer is slow: it shows only ${pictures} ${pictures === 1 ? "picture" : "pictures"} per second.`;
}

/** The browser's frames per second; null until known and after the page was hidden. */
function useDrawn(rig: Rig, presence: Presence): number | null {
  const rate = useSignal<number | null>(null);
  useEffect(() => {
    let count = 0;
    let since = performance.now();
    const restart = (now: number) => {
      [count, since] = [0, now];
    };
    const stops = [
      rig.onSample(() => {
        count++;
      }),
      presence.visible.subscribe(() => restart(performance.now())),
      presence.every(COUNT_EVERY, () => {
        const now = performance.now();
        rate.value = count === 0 ? null : (count * 1000) / (now - since);
        restart(now);
      }),
    ];
    return () => {
      for (const stop of stops) stop();
    };
  }, [rig, presence, rate]);
  return rate.value;
}

/** Share of the stream's newest frames that repeat the view although the camera moved; null until known. */
function useRepeats(source: Source | null, presence: Presence): number | null {
  const share = useSignal<number | null>(null);
  useEffect(() => {
    share.value = null;
    if (source?.stats.peek().kind !== "stream") return undefined;
    const asking = new AbortController();
    let before: SessionStatus | null = null;
    const stop = presence.every(ASK_EVERY, () => {
      void source.status?.(asking.signal).then((status) => {
        if (asking.signal.aborted) return;
        share.value = repeatedShare(before, status);
        before = status;
      });
    });
    return () => {
      asking.abort();
      stop();
    };
  }, [source, presence, share]);
  return share.value;
}
