/** Settings of a comparison, and those shared by both sides. */
import { ChevronDown } from "lucide";
import type { ComponentChildren } from "preact";
import { VARIANTS } from "../../sources/registry";
import { kindsShown } from "../../sources/sides";
import { changeSettings, ladder, settings } from "../../state/app";
import { LOCKS, PLACES, type Place, type SideLock, type SideMode } from "../../state/settings";
import { Icon } from "../icon";
import { NumberField } from "./number-field";

const PLACE_NAMES: Readonly<Record<Place, string>> = { left: "Left", right: "Right" };
const LOCK_NAMES: Readonly<Record<SideLock, string>> = {
  off: "Nothing",
  resolution: "Resolution",
  bitrate: "Bit rate",
};

export function SidesPanel() {
  const { lock, lockRung, lockKbps } = settings.value;
  return (
    <>
      <div class="fields">
        {PLACES.map((place) => (
          <Choice
            key={place}
            label={PLACE_NAMES[place]}
            tone={place}
            value={settings.value[place]}
            onValue={(value) => changeSettings({ [place]: value as SideMode })}
          >
            {VARIANTS.map(({ name, title }) => (
              <option key={name} value={name}>
                {title}
              </option>
            ))}
          </Choice>
        ))}
        <Choice label="Keep the same" value={lock} onValue={(value) => changeSettings({ lock: value as SideLock })}>
          {LOCKS.map((each) => (
            <option key={each} value={each}>
              {LOCK_NAMES[each]}
            </option>
          ))}
        </Choice>
        {lock === "resolution" && (
          <Choice
            label="Rung"
            value={String(Math.min(lockRung, Math.max(0, ladder.value.length - 1)))}
            onValue={(value) => changeSettings({ lockRung: Number(value) })}
          >
            {ladder.value.map(({ name, width, height }, rung) => (
              <option key={name} value={String(rung)}>
                {name.startsWith(`${width}×`) ? name : `${width} × ${height}, ${name}`}
              </option>
            ))}
          </Choice>
        )}
        {lock === "bitrate" && (
          <NumberField
            label="At most"
            unit="kbit/s"
            min={50}
            max={100_000}
            value={lockKbps}
            onValue={(value) => changeSettings({ lockKbps: Math.round(value) })}
          />
        )}
      </div>
      <LockNote />
    </>
  );
}

/** Explanation of a lock. */
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

interface ChoiceProps {
  readonly label: string;
  /** Of the side that it is for. */
  readonly tone?: Place;
  readonly value: string;
  readonly onValue: (value: string) => void;
  readonly children: ComponentChildren;
}

function Choice({ label, tone, value, onValue, children }: ChoiceProps) {
  return (
    <label class="number-field">
      <span>
        {tone && <i class="swatch" data-tone={tone} />}
        {label}
      </span>
      <div class="select">
        <select value={value} onChange={(event) => onValue(event.currentTarget.value)}>
          {children}
        </select>
        <Icon of={ChevronDown} size={16} />
      </div>
    </label>
  );
}
