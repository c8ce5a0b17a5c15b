/** Settings of a comparison, and those shared by both sides. */
import { VARIANTS } from "#viewer/sources/registry";
import { kindsShown } from "#viewer/sources/sides";
import { PLACES } from "#viewer/state/settings";
import { ladder, settings } from "../../state/app";
import { Choice, NumberSetting } from "./setting";

export function SidesPanel() {
  const { lock, lockRung } = settings.value;
  return (
    <>
      <div class="fields">
        {PLACES.map((place) => (
          <Choice key={place} name={place} tone={place} options={VARIANTS.map(({ name, title }) => [name, title])} />
        ))}
        <Choice name="lock" />
        {lock === "resolution" && (
          <Choice
            name="lockRung"
            value={String(Math.min(lockRung, Math.max(0, ladder.value.length - 1)))}
            options={ladder.value.map(({ name, width, height }, rung) => [
              String(rung),
              name.startsWith(`${width}×`) ? name : `${width} × ${height}, ${name}`,
            ])}
            parse={Number}
          />
        )}
        {lock === "bitrate" && <NumberSetting name="lockKbps" whole />}
      </div>
      <LockNote />
    </>
  );
}

function LockNote() {
  const { lock } = settings.value;
  if (lock === "off") return null;
  const free = kindsShown(settings.value).some(({ drawsHere }) => drawsHere);
  return (
    <p class="muted small">
      {lock === "bitrate" && "A stream is encoded at this rate; of single frames, so many come as fit into it. "}
      {free && "Neither applies to a download, which uses the whole link."}
    </p>
  );
}
