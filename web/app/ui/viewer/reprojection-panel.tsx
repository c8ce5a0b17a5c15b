/** Settings of reprojection and prediction, and how reprojection is doing. */
import { turning } from "#viewer/reproject/acceleration";
import type { ViewerSession } from "#viewer/session/session";
import { applies } from "#viewer/sources/sides";
import { settings } from "../../state/app";
import { milliseconds } from "../format";
import { OverscanOptions, overscanOf } from "../overscans";
import { Choice, Toggle } from "./setting";

export function ReprojectionPanel({ session }: { session: ViewerSession }) {
  const { reprojection, overscan } = settings.value;
  const status = session.source.value?.reprojection.value;
  const note = session.unturned.value;
  const warpMs = session.source.value?.stats.value.warpMs ?? null;
  return (
    <>
      <Toggle
        name="reprojection"
        onChange={(on) => {
          if (on) turning.value = "forced";
        }}
      />
      <Toggle name="depth" disabled={!reprojection || !applies("depth", settings.value)} />
      <Toggle name="surround" disabled={!reprojection || !applies("surround", settings.value)} />
      <div class="models">
        <Choice name="overscan" disabled={!reprojection} parse={overscanOf}>
          <OverscanOptions chosen={overscan} />
        </Choice>
        <Choice name="prediction" />
      </div>
      {(note || (status === "on" && warpMs !== null)) && (
        <p class="muted small" role="status" data-reprojection={status}>
          {note ?? `On: ${milliseconds(warpMs)} ms per picture.`}
        </p>
      )}
    </>
  );
}
