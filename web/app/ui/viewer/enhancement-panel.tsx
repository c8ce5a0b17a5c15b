/** Which models enhance frames before they are shown, and how that goes. */
import { webgpuProblem } from "#viewer/enhance/device";
import type { EnhancementStatus } from "#viewer/enhance/enhancement";
import { KINDS } from "#viewer/enhance/model/enhancer";
import type { ViewerSession } from "#viewer/session/session";
import { milliseconds } from "../format";
import { enhancementNote } from "./notes";
import { SceneTraining } from "./scene-training";
import { Choice } from "./setting";

export function EnhancementPanel({ session }: { session: ViewerSession }) {
  const missing = webgpuProblem();
  const source = session.source.value;
  const status = source?.enhancement?.status.value ?? { kind: "off" };
  const stats = source?.stats.value;
  return (
    <>
      <div class="stack">
        {KINDS.map((kind) => (
          <Choice key={kind} name={kind} disabled={missing !== null} />
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

function sentence(status: EnhancementStatus, time: number | null): string {
  if (status.kind === "on") return time === null ? "On." : `On: ${milliseconds(time)} ms a frame.`;
  return enhancementNote(status) ?? "Starting…";
}
