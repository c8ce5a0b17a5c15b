/** Which models enhance frames before they are shown, and how that goes. */
import { ChevronDown } from "lucide";
import { webgpuProblem } from "../../enhance/device";
import type { EnhancementStatus } from "../../enhance/enhancement";
import { KINDS, type Kind } from "../../enhance/model/enhancer";
import { changeSettings, settings } from "../../state/app";
import type { ViewerSession } from "../../viewer/session";
import { KIND_NAMES, ModelOptions } from "../enhancement-models";
import { Icon } from "../icon";
import { milliseconds } from "./hud";
import { enhancementNote } from "./notes";
import { SceneTraining } from "./scene-training";

export function EnhancementPanel({ session }: { session: ViewerSession }) {
  const missing = webgpuProblem();
  const source = session.source.value;
  const status = source?.enhancement?.status.value ?? { kind: "off" };
  const stats = source?.stats.value;
  return (
    <>
      <div class="models">
        {KINDS.map((kind) => (
          <ModelChoice key={kind} kind={kind} disabled={missing !== null} />
        ))}
      </div>
      {missing && (
        <p class="muted small" data-enhancement="missing">
          {missing} Frames are shown as they come.
        </p>
      )}
      {!missing && status.kind !== "off" && (
        <p class="muted small" role="status" data-enhancement={status.kind}>
          {sentence(status, stats?.kind === "requests" ? stats.enhanceMs : null)}
        </p>
      )}
      <SceneTraining session={session} />
    </>
  );
}

function ModelChoice({ kind, disabled }: { kind: Kind; disabled: boolean }) {
  const chosen = settings.value[kind];
  return (
    <label class="number-field">
      <span>{KIND_NAMES[kind]}</span>
      <div class="select">
        <select
          value={chosen}
          disabled={disabled}
          onChange={(event) => changeSettings({ [kind]: event.currentTarget.value })}
        >
          <ModelOptions kind={kind} />
        </select>
        <Icon of={ChevronDown} size={16} />
      </div>
    </label>
  );
}

function sentence(status: EnhancementStatus, time: number | null): string {
  if (status.kind === "on") return time === null ? "On." : `On: ${milliseconds(time)} ms a frame.`;
  return enhancementNote(status) ?? "Starting…";
}
