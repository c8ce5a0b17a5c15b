/** Measurements over the stage. The numbers carry `data-stat`, so that scripts and tests can read them. */

import type { ComponentChildren } from "preact";
import type { EnhancementStatus } from "#viewer/enhance/enhancement";
import type { ViewerSession } from "#viewer/session/session";
import type { Source } from "#viewer/sources/source";
import { SETTINGS } from "#viewer/state/settings";
import type { Stats } from "#viewer/stateless/stats";
import { ladder } from "../../state/app";
import { bitrate, bytes, milliseconds, NONE } from "../format";
import { DetailsButton } from "./details-button";
import { EXPLANATIONS, type Explained } from "./explanations";
import { enhancementNote, Notes, serverNote } from "./notes";

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
    <section class="floating hud" aria-label="Measurements">
      <div class="hud-main">
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
        {session.silent.value && <span data-stat="silence"> – no answer, asking again…</span>}
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

/** The time it takes to turn a picture. */
export function ReprojectionRow({ stats }: { stats: Pick<Stats, "turned" | "warpMs" | "gpuMs"> }) {
  return (
    stats.turned && (
      <Row name="reprojection-time" label="Reprojection · GPU">
        {[stats.warpMs, stats.gpuMs].map(withUnit).join(" · ")}
      </Row>
    )
  );
}

/** The enhancement of the newest frame: not every model covers every rung, and refinements are not enhanced. */
export function EnhancementRow({ status, stats }: { status: EnhancementStatus; stats: Stats }) {
  if (status.kind !== "on") return null;
  const rung = stats.frame?.profile;
  return (
    <>
      <Row name="enhancement" label="Enhanced by">
        {(rung != null && status.labels[rung]) || "nothing at this size"}
      </Row>
      <Row name="enhancement-time" label="Enhancement">
        {withUnit(stats.enhanceMs)}
      </Row>
    </>
  );
}

function Details({ stats, enhancement }: { stats: Stats; enhancement: EnhancementStatus }) {
  const { server, frame, counts } = stats;
  const rung = frame?.profile == null ? undefined : ladder.value[frame.profile];
  const total = server && server.queue + server.render + server.encode;
  return (
    <dl class="hud-details">
      <Row name="motion-to-photon-p95" label={stats.turned ? "View latency, p95" : "Motion to photon, p95"}>
        {withUnit(stats.motionToPhoton?.p95)}
      </Row>
      <Row name="round-trip" label="Response time">
        {withUnit(stats.roundTrip)}
      </Row>
      <Row name="server" label="Server">
        {withUnit(total)}
      </Row>
      <Row name="server-parts" label="Queue · render · encode">
        {server ? [server.queue, server.render, server.encode].map(milliseconds).join(" · ") : NONE}
      </Row>
      <Row name="throughput" label="Throughput">
        {stats.throughput === null ? NONE : bitrate(stats.throughput)}
      </Row>
      <Row name="frame" label="Frame">
        {frame ? `${bytes(frame.bytes)}${frame.webp ? " WebP" : ""}` : NONE}
      </Row>
      {stats.video && (
        <>
          <Row name="bitrate" label="Bit rate">
            {bitrate(stats.video.bitrate)}
          </Row>
          <Row name="key-frames" label="Key frames">
            {stats.video.keyFrames}
          </Row>
        </>
      )}
      <Row name="resolution" label="Resolution">
        {frame?.width && frame.height ? `${frame.width} × ${frame.height}` : NONE}
      </Row>
      <Row name="profile" label="Profile">
        {rung?.name ?? (frame ? "Refined" : NONE)}
      </Row>
      <EnhancementRow status={enhancement} stats={stats} />
      <ReprojectionRow stats={stats} />
      <Row name="requests" label="In flight">
        {stats.inFlight}
      </Row>
      <Row name="overtaken" label="Cancelled · dropped">
        {counts.cancelled} · {counts.dropped}
      </Row>
    </dl>
  );
}

/** A labelled figure of the HUD, explained by a tooltip. */
export function Row({ name, label, children }: { name: Explained; label: string; children: ComponentChildren }) {
  return (
    <div title={EXPLANATIONS[name]}>
      <dt>{label}</dt>
      <dd data-stat={name}>{children}</dd>
    </div>
  );
}

interface FigureProps {
  readonly name: Explained;
  readonly label: string;
  /** Key of the tooltip; by default the label. */
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

/** A still camera needs no frames: none a second is no fault then. */
function rate({ newViewsPerSecond, settled, shown }: Stats): string {
  return newViewsPerSecond === 0 && settled && shown > 0 ? "idle" : String(Math.round(newViewsPerSecond));
}

/** While pictures are turned, it is not that of their pixels. */
export function latencyName({ turned }: Pick<Stats, "turned">): string {
  return turned ? "view latency" : "motion to photon";
}
