/** The measurements of each side, over its own picture: the same figures in the same places. */
import type { ComponentChildren } from "preact";
import { NO_DASH_STATS } from "../../dash/dash-player";
import { ladder } from "../../state/app";
import type { Mode } from "../../state/settings";
import type { Figures } from "../../view/meter";
import type { Side } from "../../view/presented";
import type { ViewerSession } from "../../viewer/session";
import { bitrate } from "../format";
import {
  EnhancementNote,
  EnhancementRow,
  latencyName,
  ReprojectionNote,
  ReprojectionRow,
  Row,
  ServerNote,
} from "./hud";

const NONE = "–";

export function SideFigures({ session, mode }: { session: ViewerSession; mode: Mode }) {
  const dash = session.dash.value;
  const stats = dash?.stats.value ?? NO_DASH_STATS;
  return (
    <div class="sides">
      {mode === "side-by-side" && (
        <div class="side">
          <SideHud
            side="stateless"
            title="Stateless"
            figures={session.stateless.stats.value}
            note={
              <>
                <ServerNote stats={session.stateless.stats.value} />
                <EnhancementNote status={session.enhancement.status.value} />
                <ReprojectionNote status={session.reprojector.status.value} />
              </>
            }
          >
            <EnhancementRow status={session.enhancement.status.value} stats={session.stateless.stats.value} />
            <ReprojectionRow stats={session.stateless.stats.value} />
          </SideHud>
        </div>
      )}
      <div class="side">
        <SideHud
          side="dash"
          title="DASH"
          figures={stats}
          note={<ReprojectionNote status={session.videoReprojector.status.value} />}
        >
          <Row name="live-latency" label="Live latency">
            {milliseconds(stats.liveLatency)}
          </Row>
          <Row name="target-latency" label="Target">
            {milliseconds(stats.targetLatency)}
          </Row>
          <ReprojectionRow stats={stats} />
        </SideHud>
      </div>
    </div>
  );
}

interface HudProps {
  readonly side: Side;
  readonly title: string;
  readonly figures: Figures;
  readonly children?: ComponentChildren;
  /** Below the figures. */
  readonly note?: ComponentChildren;
}

export function SideHud({ side, title, figures, children, note }: HudProps) {
  const { motionToPhoton, newViewsPerSecond, bandwidth, stalls, picture } = figures;
  const rung = picture?.rung == null ? undefined : ladder.value[picture.rung];
  return (
    <section class="floating side-hud" aria-label={`Measurements: ${title}`} data-side={side}>
      <h2>
        <i class="swatch" data-tone={side} />
        {title}
      </h2>
      <p class="figure">
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
        <Row name="resolution" label={rung?.name ?? "Resolution"}>
          {picture ? `${picture.width} × ${picture.height}` : NONE}
        </Row>
        <Row name="stalls" label="Stalls">
          {stalls.count === 0 ? "none" : `${stalls.count}, ${(stalls.time / 1000).toFixed(1)} s`}
        </Row>
        {children}
      </dl>
      {note}
    </section>
  );
}

function milliseconds(value: number | null | undefined): string {
  return value === null || value === undefined ? NONE : `${Math.round(value)} ms`;
}
