/** dash.js on a video element: the only module that uses the library. Loaded on demand, since it is larger than the page. */
import { type FragmentLoadingCompletedEvent, MediaPlayer, type MediaPlayerErrorEvent } from "dashjs";
import type { PlayStream } from "../stream/stream";
import { checkMediaSource } from "./media-source";

/** Both kinds of extensions; dash.js prefers the managed ones. */
type Extensions = { readonly [Kind in "ManagedMediaSource" | "MediaSource"]?: typeof MediaSource };

/** dash.js with its defaults: target latency and playback rates come from the manifest's ServiceDescription. */
export const playStream: PlayStream = (video, manifest, events) => {
  const { ManagedMediaSource, MediaSource } = globalThis as Extensions;
  checkMediaSource(ManagedMediaSource ?? MediaSource);
  const player = MediaPlayer().create();
  player.updateSettings({
    debug: { logLevel: 0 },
    streaming: {
      lastBitrateCachingInfo: { enabled: false }, // figures of an earlier stream do not apply
      lastMediaSettingsCachingInfo: { enabled: false },
    },
  });
  const { events: names } = MediaPlayer;
  const counted = new WeakMap<object, number>();
  const count = ({ request, response }: FragmentLoadingCompletedEvent, complete: boolean) => {
    const before = counted.get(request) ?? 0;
    const bytes = response?.byteLength ?? 0;
    const more = complete ? Math.max(0, bytes - before) : bytes;
    counted.set(request, before + more);
    if (more > 0) events.received(more);
  };
  player.on("fragmentLoadingProgress" as "fragmentLoadingCompleted", (event) => count(event, false));
  player.on(names.FRAGMENT_LOADING_COMPLETED, (event) => count(event, true));
  player.on(names.ERROR, (event) => events.failed(reasonOf(event as MediaPlayerErrorEvent)));
  const release = borrow(video);
  player.initialize(video, manifest, true);
  return {
    player: `dash.js ${player.getVersion()}`,
    latency: () => {
      const seconds = player.getCurrentLiveLatency();
      return Number.isFinite(seconds) && seconds > 0 ? seconds : null;
    },
    aim: (target) => player.updateSettings({ streaming: { delay: { liveDelay: target / 1000 } } }),
    dispose: () => {
      player.destroy();
      release();
    },
  };
};

/**
 * Removes dash.js's traces from the video when the returned function is called. dash.js leaves a failing listener behind:
 * it waits until the video can play to set the playback rate (`VideoModel`), which may happen during the next player's
 * lifetime. Its `destroy()` also resets the log level, so a play request that is interrupted by it would be logged.
 */
function borrow(video: HTMLVideoElement): () => void {
  const visit = new AbortController();
  const listen = video.addEventListener.bind(video) as EventTarget["addEventListener"];
  video.addEventListener = ((type, listener, options) => {
    const chosen = typeof options === "object" ? options : { capture: options === true };
    listen(type, listener, { ...chosen, signal: visit.signal });
  }) as EventTarget["addEventListener"];
  const play = video.play.bind(video);
  video.play = () =>
    play().catch((error: unknown) => {
      if (!visit.signal.aborted) throw error;
    });
  return () => {
    Reflect.deleteProperty(video, "addEventListener"); // uncovers the prototype's methods
    Reflect.deleteProperty(video, "play");
    visit.abort();
  };
}

function reasonOf({ error }: MediaPlayerErrorEvent): string {
  return typeof error === "object" && error.message ? `The player stopped: ${error.message}` : "The player stopped.";
}
