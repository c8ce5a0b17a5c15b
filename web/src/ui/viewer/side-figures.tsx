/** Figures over each picture on the stage: the same ones at the same positions, followed by those of its mode. */

import { NO_LOCAL_STATS } from "../../local/local-player";
import { ladder, settings } from "../../state/app";
import { isPerView } from "../../state/settings";
import type { Place } from "../../state/sides";
import { NO_STREAM_STATS } from "../../stream/stream-player";
import { NO_FIGURES } from "../../view/meter";
import type { Rig } from "../../view/rig";
import type { ViewerSession } from "../../viewer/session";
import type { Side } from "../../viewer/side";
import { bitrate, bytes } from "../format";
import { EXPLANATIONS } from "./explanations";
import { DetailsButton, EnhancementRow, latencyName, ReprojectionRow, Row } from "./hud";
import { LocalRows } from "./local-rows";
import { sideNames } from "./names";
import { enhancementNote, Notes } from "./notes";
import { useLimits } from "./use-limits";

const NONE = "–";

export function SideFigures({ session, detailed }: { session: ViewerSession; detailed: boolean }) {
  const details = settings.value.hudDetails ?? detailed;
  const [left, right] = sideNames(settings.value);
  return (
    <div class="sides">
      <SideHud place="left" title={left ?? ""} side={session.left} rig={session.rig} details={details} />
      {session.right.value && (
        <SideHud place="right" title={right ?? ""} side={session.right.value} rig={session.rig} details={details} />
      )}
    </div>
  );
}

interface HudProps {
  readonly place: Place;
  readonly title: string;
  readonly side: Side;
  readonly rig: Rig;
  readonly details: boolean;
}

function SideHud({ place, title, side, rig, details }: HudProps) {
  const figures = side.figures ?? NO_FIGURES;
  const { motionToPhoton, newViewsPerSecond, bandwidth, stalls, picture } = figures;
  const rung = picture?.rung == null ? undefined : ladder.value[picture.rung];
  const { mode } = side.settings.value;
  const limits = useLimits(side, rig);
  return (
    <div class="side">
      <section class="floating side-hud" aria-label={`Measurements: ${title}`} data-side={place} data-mode={mode}>
        <div class="hud-main">
          <h2>
            <i class="swatch" data-tone={place} />
            {title}
          </h2>
          <DetailsButton details={details} />
        </div>
        <p class="figure" title={EXPLANATIONS[figures.turned ? "view-latency" : "motion-to-photon"]}>
          <strong data-stat="motion-to-photon">{milliseconds(motionToPhoton?.p50)}</strong>
          <span class="muted">{latencyName(figures)}</span>
        </p>
        {details && (
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
            <ModeRows side={side} />
          </dl>
        )}
        <Notes
          most={details ? 2 : 1}
          of={{
            "reprojection-note": side.unturned.value,
            "enhancement-note": isPerView(mode) ? enhancementNote(side.enhancement.status.value) : null,
            ...limits,
          }}
        />
      </section>
    </div>
  );
}

/** Additional figures of a mode. */
function ModeRows({ side }: { side: Side }) {
  const { mode } = side.settings.value;
  if (mode === "local") return <LocalRows stats={side.local.value?.stats.value ?? NO_LOCAL_STATS} />;
  if (mode === "dash") {
    const stats = side.stream.value?.stats.value ?? NO_STREAM_STATS;
    return (
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
        <ReprojectionRow stats={stats} />
      </>
    );
  }
  if (mode === "webrtc") {
    const stats = side.stream.value?.stats.value ?? NO_STREAM_STATS;
    return (
      <>
        <Row name="codec" label="Codec">
          {stats.codec ?? NONE}
        </Row>
        <Row name="jitter-buffer" label="Jitter buffer">
          {milliseconds(stats.jitterBuffer)}
        </Row>
        <ReprojectionRow stats={stats} />
      </>
    );
  }
  const stats = side.stateless.stats.value;
  return (
    <>
      <EnhancementRow status={side.enhancement.status.value} stats={stats} />
      <ReprojectionRow stats={stats} />
    </>
  );
}

function milliseconds(value: number | null | undefined): string {
  return value === null || value === undefined ? NONE : `${Math.round(value)} ms`;
}
