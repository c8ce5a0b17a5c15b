/** Settings of reprojection and prediction, and how reprojection is doing. */
import { ChevronDown } from "lucide";
import type { ComponentChildren } from "preact";
import type { PredictorName } from "../../predict/registry";
import { turning } from "../../reproject/acceleration";
import { applies } from "../../sources/sides";
import { changeSettings, settings } from "../../state/app";
import type { ViewerSession } from "../../viewer/session";
import { Icon } from "../icon";
import { OverscanOptions, overscanOf } from "../overscans";
import { PredictionOptions } from "../predictions";
import { milliseconds } from "./hud";

export function ReprojectionPanel({ session }: { session: ViewerSession }) {
  const { reprojection, prediction, overscan, depth, surround } = settings.value;
  const status = session.source.value?.reprojection.value;
  const note = session.unturned.value;
  const warpMs = session.source.value?.stats.value.warpMs ?? null;
  return (
    <>
      <label class="check" title="Turns the newest frame to the current view each time the display is refreshed">
        <input
          type="checkbox"
          checked={reprojection}
          onChange={() => {
            changeSettings({ reprojection: !reprojection });
            if (!reprojection) turning.value = "forced";
          }}
        />
        Smooth turning (reprojection)
      </label>
      <label class="check" title="Near things shift more than distant ones as you walk, by a coarse depth map">
        <input
          type="checkbox"
          checked={depth}
          disabled={!reprojection || !applies("depth", settings.value)}
          onChange={() => changeSettings({ depth: !depth })}
        />
        Use depth
      </label>
      <label class="check" title="Small pictures of all directions fill what a quick turn would leave dark">
        <input
          type="checkbox"
          checked={surround}
          disabled={!reprojection || !applies("surround", settings.value)}
          onChange={() => changeSettings({ surround: !surround })}
        />
        Fill the edges on fast turns
      </label>
      <div class="models">
        <Choice
          label="Overscan"
          title="How far each frame extends beyond the view, as a share of its size"
          value={String(overscan)}
          disabled={!reprojection}
          onValue={(value) => changeSettings({ overscan: overscanOf(value) })}
        >
          <OverscanOptions chosen={overscan} />
        </Choice>
        <Choice
          label="Prediction"
          title="Requests the view from the predicted camera position"
          value={prediction}
          onValue={(value) => changeSettings({ prediction: value as PredictorName })}
        >
          <PredictionOptions />
        </Choice>
      </div>
      {(note || (status === "on" && warpMs !== null)) && (
        <p class="muted small" role="status" data-reprojection={status}>
          {note ?? `On: ${milliseconds(warpMs)} ms per picture.`}
        </p>
      )}
    </>
  );
}

interface ChoiceProps {
  readonly label: string;
  readonly title: string;
  readonly value: string;
  readonly disabled?: boolean;
  readonly onValue: (value: string) => void;
  readonly children: ComponentChildren;
}

function Choice({ label, title, value, disabled, onValue, children }: ChoiceProps) {
  return (
    <label class="number-field" title={title}>
      <span>{label}</span>
      <div class="select">
        <select value={value} disabled={disabled} onChange={(event) => onValue(event.currentTarget.value)}>
          {children}
        </select>
        <Icon of={ChevronDown} size={16} />
      </div>
    </label>
  );
}
