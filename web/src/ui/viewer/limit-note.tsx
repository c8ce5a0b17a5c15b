/** What limits a picture on the stage, where it is not the link: renderer or encoder, or this machine. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { isPerView } from "../../state/settings";
import { MANY_REPEATS, repeatedShare } from "../../stream/repeats";
import type { StreamPlayer } from "../../stream/stream-player";
import type { Rig } from "../../view/rig";
import type { Side } from "../../viewer/side";
import type { SessionStatus } from "../../wire/dash";
import { ServerNote } from "./hud";

/** How often the packager is asked how it does, in milliseconds. */
const ASK_EVERY = 2000;
/** How often pictures of the display are counted, in milliseconds. */
const COUNT_EVERY = 2000;
/** With fewer a second, no mode can look smooth here. */
const FEW_PICTURES = 30;

export function LimitNote({ side, rig }: { side: Side; rig: Rig }) {
  const { mode } = side.settings.value;
  const drawn = useDrawn(rig);
  const repeated = useRepeats(side.stream.value);
  return (
    <>
      {isPerView(mode) && <ServerNote stats={side.stateless.stats.value} />}
      {repeated !== null && repeated > MANY_REPEATS && (
        <p class="hud-note" role="status" data-stat="server-note">
          Renderer or encoder is the limit, not the link: {Math.round(repeated * 100)} % of the stream’s frames show
          nothing new.
        </p>
      )}
      {drawn !== null && drawn < FEW_PICTURES && (
        <p class="hud-note" role="status" data-stat="browser-note">
          This machine is the limit: its browser draws {Math.round(drawn)} pictures a second.
        </p>
      )}
    </>
  );
}

/** How many pictures a second this browser draws, whatever they show; null before that is known, and after the page was hidden. */
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

/** The share of the stream's newest frames that show nothing new although the camera moved; null before that is known. */
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
