/** Over the stage, while the settings are closed: the last walk in one sentence, which opens all of its figures. */

import type { ViewerSession } from "#viewer/session/session";
import { sideTitles } from "#viewer/sources/sides";
import { settings } from "../../state/app";
import { verdict } from "./last-walk";

export function WalkVerdict({ session, onOpen }: { session: ViewerSession; onOpen: () => void }) {
  const comparison = session.comparison.value;
  const walk = comparison?.walks.last.value;
  if (!comparison || !walk || comparison.sides.length < 2) return null;
  return (
    <button type="button" class="floating walk-verdict" title="All figures of the walk" onClick={onOpen}>
      <span role="status">{verdict(walk, sideTitles(settings.value), comparison.quality.value)}</span>
    </button>
  );
}
