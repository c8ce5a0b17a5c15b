/** Bottlenecks other than the link: the renderer or encoder, or this computer. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { isPerView } from "../../state/settings";
import { MANY_REPEATS, repeatedShare } from "../../stream/repeats";
import type { StreamPlayer } from "../../stream/stream-player";
import type { Rig } from "../../view/rig";
import type { Side } from "../../viewer/side";
import type { SessionStatus } from "../../wire/dash";
import { type Said, serverNote } from "./notes";

/** Polling interval of the packager's status, in milliseconds. */
const ASK_EVERY = 2000;
/** How often drawn pictures are counted, in milliseconds. */
const COUNT_EVERY = 2000;
/** With fewer a second, no mode can look smooth here. */
const FEW_PICTURES = 30;

export function useLimits(side: Side, rig: Rig): Said {
  const drawn = useDrawn(rig);
  const repeated = useRepeats(side.stream.value);
  return {
    "server-note": isPerView(side.settings.value.mode) ? serverNote(side.stateless.stats.value) : streamNote(repeated),
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
function useDrawn(rig: Rig): number | null {
  const rate = useSignal<number | null>(null);
  useEffect(() => {
    let count = 0;
    let since = performance.now();
    const stop = rig.onSample(() => {
      count++;
    });
    const timer = setInterval(() => {
      const now = performance.now();
      rate.value = document.hidden || count === 0 ? null : (count * 1000) / (now - since);
      [count, since] = [0, now];
    }, COUNT_EVERY);
    return () => {
      stop();
      clearInterval(timer);
    };
  }, [rig, rate]);
  return rate.value;
}

/** Share of the stream's newest frames that repeat the view although the camera moved; null until known. */
function useRepeats(stream: StreamPlayer | null): number | null {
  const share = useSignal<number | null>(null);
  useEffect(() => {
    share.value = null;
    if (stream === null) return undefined;
    const asking = new AbortController();
    let before: SessionStatus | null = null;
    const timer = setInterval(() => {
      void stream.status(asking.signal).then((status) => {
        if (asking.signal.aborted) return;
        share.value = repeatedShare(before, status);
        before = status;
      });
    }, ASK_EVERY);
    return () => {
      asking.abort();
      clearInterval(timer);
    };
  }, [stream, share]);
  return share.value;
}
