/** Measurements over the stage. The numbers carry `data-stat`, so that scripts and tests can read them. */

import type { ComponentChildren } from "preact";
import type { EnhancementStatus } from "#viewer/enhance/enhancement";
import type { ViewerSession } from "#viewer/session/session";
import type { Source } from "#viewer/sources/source";
import { SETTINGS } from "#viewer/state/settings";
import type { Stats } from "#viewer/stateless/stats";
import { ladder } from "../../state/app";
import { bitrate, bytes, milliseconds, NONE } from "../format";
import { EXPLANATIONS, type Explained } from "./explanations";
import { DetailsButton, enhancementNote, Notes, serverNote } from "./notes";

interface HudProps {
  readonly session: ViewerSession;
  readonly source: Source;
  readonly stats: Stats;
  /** Problem with the link that opened this view. */
  readonly linkNote?: string | null;
}

export function Hud({ session, source, stats, linkNote }: HudProps) {
  const enhancement = source.enhancement?.status.value ?? { kind: "off" };
  const { fallback, host } = session.connected.value ?? {};
  return (
    <section class="floating hud small" aria-label="Measurements">
      <div class="hud-main row">
        <Figure name="new-views" label="new views/s" value={rate(stats)} />
        <Figure
          name="motion-to-photon"
          label={latencyName(stats)}
          explanation={stats.turned ? "view-latency" : "motion-to-photon"}
          value={milliseconds(stats.motionToPhoton?.p50)}
          unit="ms"
        />
        {stats.turned && (
          <Figure name="content-age" label="content age" value={milliseconds(stats.contentAge)} unit="ms" />
        )}
        <DetailsButton details />
      </div>
      <Details stats={stats} enhancement={enhancement} />
      <p class="hud-transport" title={EXPLANATIONS.transport}>
        <span class="dot" data-transport={stats.transport ?? "none"} />
        <span data-stat="transport">
          {stats.transport ? SETTINGS.transport.options[stats.transport] : "not connected"}
        </span>
        {fallback && (
          <span class="muted" data-stat="fallback">
            {" "}
            – {fallback}
          </span>
        )}
        {host && (
          <span class="muted">
            {" "}
            from <span data-stat="host">{host}</span>
          </span>
        )}
        {session.silent.value && <span data-stat="silence"> – no response, retrying…</span>}
      </p>
      <Notes
        most={2}
        of={{
          "link-note": linkNote ?? null,
          "reprojection-note": session.unturned.value,
          "enhancement-note": enhancementNote(enhancement),
          "server-note": serverNote(stats),
        }}
      />
    </section>
  );
}

/** A figure: its name, its label, and its value, or null if it is unknown. */
export type FigureRow = readonly [name: Explained, label: string, value: ComponentChildren];

export function Rows({ of }: { readonly of: readonly FigureRow[] }) {
  return (
    <>
      {of.map(([name, label, value]) => (
        <div key={name} class="row spread" title={EXPLANATIONS[name]}>
          <dt class="muted">{label}</dt>
          <dd data-stat={name}>{value ?? NONE}</dd>
        </div>
      ))}
    </>
  );
}

/** The time it takes to turn a picture. */
export function reprojectionRow({ turned, warpMs, gpuMs }: Pick<Stats, "turned" | "warpMs" | "gpuMs">): FigureRow[] {
  return turned ? [["reprojection-time", "Reprojection · GPU", [warpMs, gpuMs].map(withUnit).join(" · ")]] : [];
}

/** The enhancement of the newest frame: not every model covers every rung, and refinements are not enhanced. */
export function enhancementRows(status: EnhancementStatus, { frame, enhanceMs }: Stats): FigureRow[] {
  if (status.kind !== "on") return [];
  const label = frame?.profile == null ? undefined : status.labels[frame.profile];
  return [
    ["enhancement", "Enhanced by", label || "no model at this size"],
    ["enhancement-time", "Enhancement", withUnit(enhanceMs)],
  ];
}

function Details({ stats, enhancement }: { stats: Stats; enhancement: EnhancementStatus }) {
  const { server, frame, counts, video, turned } = stats;
  const rung = frame?.profile == null ? undefined : ladder.value[frame.profile];
  const total = server && server.queue + server.render + server.encode;
  const parts = server && [server.queue, server.render, server.encode].map(milliseconds).join(" · ");
  const videoRows: FigureRow[] = video
    ? [
        ["bitrate", "Bit rate", bitrate(video.bitrate)],
        ["key-frames", "Key frames", video.keyFrames],
      ]
    : [];
  const rows: FigureRow[] = [
    [
      "motion-to-photon-p95",
      turned ? "View latency, p95" : "Motion to photon, p95",
      withUnit(stats.motionToPhoton?.p95),
    ],
    ["round-trip", "Response time", withUnit(stats.roundTrip)],
    ["server", "Server", withUnit(total)],
    ["server-parts", "Queue · render · encode", parts],
    ["throughput", "Throughput", stats.throughput === null ? null : bitrate(stats.throughput)],
    ["frame", "Frame", frame && `${bytes(frame.bytes)}${frame.webp ? " WebP" : ""}`],
    ...videoRows,
    ["resolution", "Resolution", frame?.width && frame.height ? `${frame.width} × ${frame.height}` : null],
    ["profile", "Profile", rung?.name ?? (frame && "Refined")],
    ...enhancementRows(enhancement, stats),
    ...reprojectionRow(stats),
    ["requests", "In flight", stats.inFlight],
    ["overtaken", "Cancelled · dropped", `${counts.cancelled} · ${counts.dropped}`],
  ];
  return (
    <dl class="hud-details stack">
      <Rows of={rows} />
    </dl>
  );
}

interface FigureProps {
  readonly name: Explained;
  readonly label: string;
  /** Key of the tooltip; by default the name. */
  readonly explanation?: Explained;
  readonly value: string;
  readonly unit?: string;
}

function Figure({ name, label, explanation = name, value, unit }: FigureProps) {
  return (
    <p class="figure" title={EXPLANATIONS[explanation]}>
      <strong>
        <span data-stat={name}>{value}</span>
        {unit && value !== NONE && <small> {unit}</small>}
      </strong>
      <span class="muted">{label}</span>
    </p>
  );
}

function withUnit(value: number | null | undefined): string {
  return value === null || value === undefined ? NONE : `${milliseconds(value)} ms`;
}

/** The rate of new views; a still camera needs none and is idle. */
function rate({ newViewsPerSecond, settled, shown }: Stats): string {
  return newViewsPerSecond === 0 && settled && shown > 0 ? "idle" : String(Math.round(newViewsPerSecond));
}

/** While pictures are turned, the latency is the view's, not that of their pixels. */
export function latencyName({ turned }: Pick<Stats, "turned">): string {
  return turned ? "view latency" : "motion to photon";
}
