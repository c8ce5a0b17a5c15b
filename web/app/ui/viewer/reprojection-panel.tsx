/** Settings of reprojection and prediction, and the status of reprojection. */
import { turning } from "#viewer/reproject/acceleration";
import type { ViewerSession } from "#viewer/session/session";
import { applies } from "#viewer/sources/sides";
import { settings } from "../../state/app";
import { milliseconds } from "../format";
import { Choice, Toggle } from "./setting";

/** Shares of the view's size by which frames extend at each side. */
const SHARES = [0, 0.05, 0.1, 0.15, 0.2, 0.25];
const percent = (share: number) => [String(share), `${Math.round(share * 1000) / 10} %`] as const;

export function ReprojectionPanel({ session }: { session: ViewerSession }) {
  const { reprojection, overscan } = settings.value;
  const shares = overscan === "auto" || SHARES.includes(overscan) ? SHARES : [...SHARES, overscan];
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
      <div class="stack">
        <Choice
          name="overscan"
          disabled={!reprojection}
          options={[["auto", "Automatic"], ...shares.map(percent)]}
          parse={(value) => (value === "auto" ? value : Number(value))}
        />
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
