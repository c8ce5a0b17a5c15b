/** Figures over each picture on the stage: the same ones at the same positions, then its mode's own. */

import type { ViewerSession } from "#viewer/session/session";
import type { Side } from "#viewer/session/side";
import { sideTitles } from "#viewer/sources/sides";
import type { Source } from "#viewer/sources/source";
import type { Place } from "#viewer/state/settings";
import { NO_FIGURES } from "#viewer/view/meter";
import { ladder, settings } from "../../state/app";
import { bitrate, bytes, NONE } from "../format";
import { DetailsButton } from "./details-button";
import { EXPLANATIONS } from "./explanations";
import { EnhancementRow, latencyName, ReprojectionRow, Row } from "./hud";
import { LocalRows } from "./local-rows";
import { enhancementNote, Notes } from "./notes";
import { useLimits } from "./use-limits";

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
  return (
    <div class="side">
      <section class="floating side-hud" aria-label={`Measurements: ${title}`} data-side={place} data-mode={mode}>
        <div class="hud-main">
          <h2>
            <i class="swatch" data-tone={place} />
            {title}
          </h2>
          <DetailsButton details />
        </div>
        <p class="figure" title={EXPLANATIONS[figures.turned ? "view-latency" : "motion-to-photon"]}>
          <strong data-stat="motion-to-photon">{milliseconds(motionToPhoton?.p50)}</strong>
          <span class="muted">{latencyName(figures)}</span>
        </p>
        <dl class="hud-details">
          <Row name="motion-to-photon-p95" label="p95">
            {milliseconds(motionToPhoton?.p95)}
          </Row>
          {figures.turned && (
            <Row name="content-age" label="Content age">
              {milliseconds(figures.contentAge)}
            </Row>
          )}
          <Row name="new-views" label="New views/s">
            {Math.round(newViewsPerSecond)}
          </Row>
          <Row name="bandwidth" label="Bandwidth">
            {bitrate(bandwidth)}
          </Row>
          <Row name="received" label="Received">
            {bytes(figures.bytes)}
          </Row>
          <Row name="resolution" label={rung?.name ?? "Resolution"}>
            {picture ? `${picture.width} × ${picture.height}` : NONE}
          </Row>
          <Row name="stalls" label="Stalls">
            {stalls.count === 0 ? "none" : `${stalls.count}, ${(stalls.time / 1000).toFixed(1)} s`}
          </Row>
          {source && <SourceRows source={source} />}
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

/** Additional figures of how the scene is delivered. */
function SourceRows({ source }: { source: Source }) {
  const stats = source.stats.value;
  switch (stats.kind) {
    case "download":
      return <LocalRows stats={stats} />;
    case "stream":
      return (
        <>
          {stats.codec === null ? (
            <>
              <Row name="live-latency" label="Live latency">
                {milliseconds(stats.liveLatency)}
              </Row>
              <Row name="target-latency" label="Target">
                {milliseconds(stats.targetLatency)}
              </Row>
              <Row name="buffered" label="Buffer">
                {milliseconds(stats.buffered)}
              </Row>
            </>
          ) : (
            <>
              <Row name="codec" label="Codec">
                {stats.codec}
              </Row>
              <Row name="jitter-buffer" label="Jitter buffer">
                {milliseconds(stats.jitterBuffer)}
              </Row>
            </>
          )}
          <ReprojectionRow stats={stats} />
        </>
      );
    case "requests":
      return (
        <>
          {source.enhancement && <EnhancementRow status={source.enhancement.status.value} stats={stats} />}
          <ReprojectionRow stats={stats} />
        </>
      );
  }
}

function milliseconds(value: number | null | undefined): string {
  return value === null || value === undefined ? NONE : `${Math.round(value)} ms`;
}
