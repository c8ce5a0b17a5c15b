/** Each picture on the stage in one line, such as "Live · 24 views/s · 48 ms"; the lab shows the measurements in full. */

import { useEffect } from "preact/hooks";
import type { Phase, ViewerSession } from "#viewer/session/session";
import type { Side } from "#viewer/session/side";
import { sideTitles } from "#viewer/sources/sides";
import type { Rig } from "#viewer/view/rig";
import { changeSettings, settings } from "../../state/app";
import { milliseconds } from "../format";
import { TOUCH, useMedia } from "../hooks";
import { DetailsButton, enhancementNote, Notes, serverNote } from "./notes";

/** Explains how to move, over the picture, until the first movement. */
export function Hint({ rig }: { readonly rig: Rig }) {
  useEffect(() => onFirstMovement(rig, () => changeSettings({ hint: false })), [rig]);
  const touch = useMedia(TOUCH);
  const drag = settings.value.drag === "orbit" ? "Drag to orbit" : "Drag to look";
  return (
    <p class="floating hint-line row small">
      {touch
        ? `${drag} · pad or pinch to move · double-tap to go there`
        : `${drag} · WASD or wheel to move · double-click to go there`}
    </p>
  );
}

/** Calls back once the user moves the camera; cuts and movements that drive it do not count. */
function onFirstMovement(rig: Rig, moved: () => void): () => void {
  let { placements } = rig;
  let { seq } = rig.pose;
  return rig.onSample((pose) => {
    if (pose.seq !== seq && rig.placements === placements && rig.source.peek() === null) moved();
    placements = rig.placements;
    seq = pose.seq;
  });
}

interface Props {
  readonly session: ViewerSession;
  /** Problem with the link that opened this view. */
  readonly linkNote: string | null;
}

export function StatusLines({ session, linkNote }: Props) {
  const sides = [session.left, session.right.value].filter((side) => side !== null);
  const names = sideTitles(settings.value);
  return (
    <div class="sides">
      {sides.map((side, i) => (
        <div key={i === 0 ? "left" : "right"} class="side">
          <StatusLine
            side={side}
            name={sides.length > 1 ? (names[i] ?? null) : null}
            phase={session.phase.value}
            silent={i === 0 && session.silent.value}
            linkNote={i === 0 ? linkNote : null}
          />
        </div>
      ))}
    </div>
  );
}

interface LineProps {
  readonly side: Side;
  /** Name of the side in a comparison. */
  readonly name: string | null;
  readonly phase: Phase;
  readonly silent: boolean;
  readonly linkNote: string | null;
}

function StatusLine({ side, name, phase, silent, linkNote }: LineProps) {
  const { figures } = side;
  const enhancement = side.source.value?.enhancement?.status.value;
  const views = Math.round(figures?.newViewsPerSecond ?? 0);
  const latency = figures?.motionToPhoton?.p50;
  return (
    <section class="floating status-line small" aria-label={name ? `Status: ${name}` : "Status"} data-live={!silent}>
      <p>
        <span data-stat="status">{silent ? "No response, retrying…" : (name ?? state(side, phase))}</span>
        {views > 0 && (
          <span title="New pictures per second">
            <span data-stat="new-views">{views}</span> views/s
          </span>
        )}
        {latency !== undefined && (
          <span title="Time from your input to the picture">
            <span data-stat="motion-to-photon">{milliseconds(latency)}</span> ms
          </span>
        )}
        {settings.value.sidebar && <DetailsButton details={false} />}
      </p>
      <Notes
        most={1}
        of={{
          "link-note": linkNote,
          "reprojection-note": side.unturned.value,
          "enhancement-note": enhancement ? enhancementNote(enhancement) : null,
          "server-note": figures?.kind === "requests" ? serverNote(figures) : null,
        }}
      />
    </section>
  );
}

function state(side: Side, phase: Phase): string {
  if (side.kind.value.requests && ["lost", "full", "failed"].includes(phase.kind)) return "Not connected";
  if (side.source.value?.phase.value.kind !== "playing") return "No picture";
  return side.kind.value.drawsHere ? "On this device" : "Live";
}
