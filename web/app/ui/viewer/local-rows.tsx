/** Additional figures of a download: its progress and the rendered part. */
import type { LocalStats } from "#viewer/local/local-player";
import { bytes, NONE } from "../format";
import { Row } from "./hud";

export function LocalRows({ stats }: { stats: LocalStats }) {
  const { received, total, drawn, gaussians, firstPictureMs, completeMs, backend } = stats;
  return (
    <>
      <Row name="downloaded" label="Download">
        {total === null ? bytes(received) : received < total ? `${bytes(received)} of ${bytes(total)}` : bytes(total)}
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
    </>
  );
}

function count(value: number): string {
  return value.toLocaleString("en");
}

function seconds(ms: number | null): string {
  return ms === null ? NONE : `${(ms / 1000).toFixed(1)} s`;
}
