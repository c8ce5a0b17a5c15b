/** The measurements of the mode that downloads the scene: how far that is, and what is drawn of it. */
import { NO_LOCAL_STATS } from "../../local/local-player";
import type { ViewerSession } from "../../viewer/session";
import { bytes } from "../format";
import { Row } from "./hud";
import { SideHud } from "./side-figures";

const NONE = "–";

export function LocalHud({ session }: { session: ViewerSession }) {
  const stats = session.local.value?.stats.value ?? NO_LOCAL_STATS;
  const { received, total, drawn, gaussians, firstPictureMs, completeMs, backend } = stats;
  return (
    <div class="sides">
      <div class="side">
        <SideHud side="local" title="Local" figures={stats}>
          <Row name="downloaded" label="Download">
            {total === null ? NONE : received < total ? `${bytes(received)} of ${bytes(total)}` : bytes(total)}
          </Row>
          {total !== null && received < total && (
            <progress aria-label="Download" data-stat="download" max={total} value={received} />
          )}
          <Row name="gaussians" label="Gaussians">
            {gaussians === null ? NONE : drawn < gaussians ? `${count(drawn)} of ${count(gaussians)}` : count(drawn)}
          </Row>
          <Row name="first-picture" label="First picture">
            {seconds(firstPictureMs)}
          </Row>
          <Row name="complete" label="Complete">
            {seconds(completeMs)}
          </Row>
          <Row name="renderer" label="Drawn with">
            {backend ?? NONE}
          </Row>
        </SideHud>
      </div>
    </div>
  );
}

function count(value: number): string {
  return value.toLocaleString("en");
}

function seconds(ms: number | null): string {
  return ms === null ? NONE : `${(ms / 1000).toFixed(1)} s`;
}
