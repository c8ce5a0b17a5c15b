/** All measurements: every figure of single pictures, or else the same figures for each side and then its mode's own. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { SessionStatus } from "#client/wire/dash";
import type { LocalStats } from "#viewer/local/local-player";
import type { ViewerSession } from "#viewer/session/session";
import type { Side } from "#viewer/session/side";
import { sideTitles } from "#viewer/sources/sides";
import type { Source } from "#viewer/sources/source";
import type { Place } from "#viewer/state/settings";
import { MANY_REPEATS, repeatedShare } from "#viewer/stream/packager";
import { NO_FIGURES } from "#viewer/view/meter";
import type { Presence } from "#viewer/view/presence";
import type { Rig } from "#viewer/view/rig";
import { ladder, settings } from "../../state/app";
import { bitrate, bytes, NONE } from "../format";
import { EXPLANATIONS } from "./explanations";
import { enhancementRows, type FigureRow, Hud, latencyName, Rows, reprojectionRow } from "./hud";
import { DetailsButton, enhancementNote, Notes, type Said, serverNote } from "./notes";

/** Polling interval of the packager's status, in milliseconds. */
const ASK_EVERY = 2000;
/** Interval of counting drawn pictures, in milliseconds. */
const COUNT_EVERY = 2000;
/** With fewer per second, no mode can look smooth. */
const FEW_PICTURES = 30;

export function Figures({ session, linkNote }: { readonly session: ViewerSession; readonly linkNote: string | null }) {
  const source = session.source.value;
  const stats = source?.stats.value;
  if (source === null || stats?.kind !== "requests" || session.right.value) return <SideFigures session={session} />;
  return <Hud session={session} source={source} stats={stats} linkNote={linkNote} />;
}

export function SideFigures({ session }: { session: ViewerSession }) {
  const [left, right] = sideTitles(settings.value);
  return (
    <div class="sides">
      <SideHud place="left" title={left ?? ""} side={session.left} session={session} />
      {session.right.value && (
        <SideHud place="right" title={right ?? ""} side={session.right.value} session={session} />
      )}
    </div>
  );
}

interface HudProps {
  readonly place: Place;
  readonly title: string;
  readonly side: Side;
  readonly session: ViewerSession;
}

function SideHud({ place, title, side, session }: HudProps) {
  const figures = side.figures ?? NO_FIGURES;
  const { motionToPhoton, newViewsPerSecond, bandwidth, stalls, picture } = figures;
  const rung = picture?.rung == null ? undefined : ladder.value[picture.rung];
  const { mode } = side.settings.value;
  const source = side.source.value;
  const enhancement = source?.enhancement?.status.value;
  const limits = useLimits(side, session);
  const contentAge: FigureRow[] = figures.turned
    ? [["content-age", "Content age", milliseconds(figures.contentAge)]]
    : [];
  return (
    <div class="side">
      <section class="floating side-hud small" aria-label={`Measurements: ${title}`} data-side={place} data-mode={mode}>
        <div class="hud-main row">
          <h2 class="small">
            <i class="swatch" data-tone={place} />
            {title}
          </h2>
          <DetailsButton details />
        </div>
        <p class="figure" title={EXPLANATIONS[figures.turned ? "view-latency" : "motion-to-photon"]}>
          <strong data-stat="motion-to-photon">{milliseconds(motionToPhoton?.p50) ?? NONE}</strong>
          <span class="muted">{latencyName(figures)}</span>
        </p>
        <dl class="hud-details stack">
          <Rows
            of={[
              ["motion-to-photon-p95", "p95", milliseconds(motionToPhoton?.p95)],
              ...contentAge,
              ["new-views", "New views/s", Math.round(newViewsPerSecond)],
              ["bandwidth", "Bandwidth", bitrate(bandwidth)],
              ["received", "Received", bytes(figures.bytes)],
              ["resolution", rung?.name ?? "Resolution", picture && `${picture.width} × ${picture.height}`],
              [
                "stalls",
                "Stalls",
                stalls.count === 0 ? "none" : `${stalls.count}, ${(stalls.time / 1000).toFixed(1)} s`,
              ],
              ...(source ? sourceRows(source) : []),
            ]}
          />
        </dl>
        <Notes
          most={2}
          of={{
            "reprojection-note": side.unturned.value,
            "enhancement-note": enhancement ? enhancementNote(enhancement) : null,
            ...limits,
          }}
        />
      </section>
    </div>
  );
}

/** Bottlenecks other than the link: the renderer or encoder, or this device. */
function useLimits(side: Side, { rig, presence }: Pick<ViewerSession, "rig" | "presence">): Said {
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
  return `This device is slow: it shows only ${pictures} ${pictures === 1 ? "picture" : "pictures"} per second.`;
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

/** Additional figures of how the scene is delivered. */
function sourceRows({ stats: { value: stats }, enhancement }: Pick<Source, "stats" | "enhancement">): FigureRow[] {
  switch (stats.kind) {
    case "download":
      return localRows(stats);
    case "stream":
      if (stats.codec === null) {
        return [
          ["live-latency", "Live latency", milliseconds(stats.liveLatency)],
          ["target-latency", "Target", milliseconds(stats.targetLatency)],
          ["buffered", "Buffer", milliseconds(stats.buffered)],
          ...reprojectionRow(stats),
        ];
      }
      return [
        ["codec", "Codec", stats.codec],
        ["jitter-buffer", "Jitter buffer", milliseconds(stats.jitterBuffer)],
        ...reprojectionRow(stats),
      ];
    case "requests":
      return [...(enhancement ? enhancementRows(enhancement.status.value, stats) : []), ...reprojectionRow(stats)];
  }
}

/** Additional figures of a download: its progress and the rendered part. */
export function localRows(stats: LocalStats): FigureRow[] {
  const { received, total, drawn, gaussians, firstPictureMs, completeMs, backend } = stats;
  const loading = total !== null && received < total;
  return [
    [
      "downloaded",
      "Download",
      loading ? (
        <>
          {bytes(received)} of {bytes(total)}
          <progress aria-label="Download" data-stat="download" max={total} value={received} />
        </>
      ) : (
        bytes(total ?? received)
      ),
    ],
    [
      "gaussians",
      "Gaussians",
      gaussians === null ? null : drawn < gaussians ? `${count(drawn)} of ${count(gaussians)}` : count(drawn),
    ],
    ["first-picture", "First picture", seconds(firstPictureMs)],
    ["complete", "Complete", seconds(completeMs)],
    ["renderer", "Drawn with", backend],
  ];
}

function milliseconds(value: number | null | undefined): string | null {
  return value == null ? null : `${Math.round(value)} ms`;
}

function count(value: number): string {
  return value.toLocaleString("en");
}

function seconds(ms: number | null): string | null {
  return ms === null ? null : `${(ms / 1000).toFixed(1)} s`;
}
