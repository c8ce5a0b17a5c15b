/** Selects the mode and the parameters of its stream. */
import { type DashPlan, type DashSetup, FRAME_RATES, planFor } from "#viewer/dash/presets";
import type { ViewerSession } from "#viewer/session/session";
import { SOURCES, VARIANTS } from "#viewer/sources/registry";
import { applies, kindsShown, settingsShown, titleOf } from "#viewer/sources/sides";
import { COMPARED, MODES, PLACES } from "#viewer/state/settings";
import { changeSettings, ladder, settings } from "../../state/app";
import { NumberField } from "../fields";
import { Notice } from "../notice";
import { ComparisonPanel } from "./comparison-panel";
import { Choice, NumberSetting, SegmentList, Segments } from "./setting";

/** Settings of a comparison, and those shared by both sides. */
function SidesPanel() {
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
      {lock === "bitrate" && "Streams are encoded at this rate; single frames arrive as often as it allows. "}
      {free && "This does not apply to downloads, which use the whole link."}
    </p>
  );
}

export function ModePanel({ session }: { session: ViewerSession }) {
  const { mode } = settings.value;
  const sides = [session.left, session.right.value].filter((side) => side !== null);
  const problem = sides.find((side) => side.missing.value !== null);
  const { about } = session.left.kind.value;
  const levels = session.scene.value?.downloads?.some(({ form }) => form === "streamed");
  return (
    <>
      <SegmentList
        name="mode"
        label="Mode"
        choices={MODES.map((each) => ({ title: titleOf(each), chosen: mode === each, part: { mode: each } }))}
      />
      {mode === COMPARED && <SidesPanel />}
      {problem ? (
        <Notice>
          {problem.missing.value}. {problem.kind.value.remedy}
        </Notice>
      ) : (
        <>
          {applies("dashCustom", settings.value) && <Streams />}
          {applies("webrtcStream", settings.value) && <WebRtc />}
          {levels && applies("localForm", settings.value) && <Segments name="localForm" />}
          {mode !== COMPARED && about && <p class="muted small">{about}</p>}
        </>
      )}
      <ComparisonPanel session={session} />
    </>
  );
}

/** DASH settings: the preset, unless each side has one, and shared parameters. */
function Streams() {
  const { mode, dashCustom } = settings.value;
  const plans = settingsShown(settings.value)
    .filter(({ mode: each }) => SOURCES[each].settings.includes("dashCustom"))
    .map((shown) => ({ ...planFor(shown), custom: shown.dashPreset === "custom" }));
  const custom = plans.some((one) => one.custom);
  const [plan] = plans;
  const compared = mode === COMPARED;
  return (
    <>
      <h4>DASH stream</h4>
      {!compared && <Segments name="dashPreset" />}
      {custom && <Custom setup={dashCustom} />}
      {!custom && (
        <SegmentList
          name="frame-rate"
          label="Frame rate"
          choices={FRAME_RATES.map((rate) => ({
            title: `${rate} frames/s`,
            chosen: rate === plan?.setup.frame_rate,
            part: { dashFrameRate: rate },
          }))}
        />
      )}
      <Segments name="dashTransport" />
      {!compared && !custom && plan && <p class="muted small">{sentence(plan)}</p>}
    </>
  );
}

/** How streams over WebRTC are encoded. */
function WebRtc() {
  return (
    <>
      <h4>WebRTC stream</h4>
      <Segments name="webrtcStream" />
      <p class="muted small">A video at the bit rate that the browser estimates for the link.</p>
    </>
  );
}

function Custom({ setup }: { setup: DashSetup }) {
  const field = (name: keyof DashSetup, label: string, unit: string, min: number, max: number) => (
    <NumberField
      label={label}
      unit={unit}
      min={min}
      max={max}
      value={setup[name]}
      onValue={(value) => {
        const changed = { ...setup, [name]: name === "segment_s" ? value : Math.round(value) };
        const frames_per_chunk = Math.min(changed.frames_per_chunk, framesOf(changed));
        changeSettings({ dashCustom: { ...changed, frames_per_chunk } });
      }}
    />
  );
  return (
    <div class="fields">
      {field("segment_s", "Segment", "s", 0.2, 10)}
      {field("frames_per_chunk", "Chunk", "frames", 1, framesOf(setup))}
      {field("target_latency_ms", "Target", "ms", 50, 10_000)}
      {field("frame_rate", "Rate", "frames/s", 1, 60)}
    </div>
  );
}

/** Frames in a segment, the most that a chunk can have. */
function framesOf({ segment_s, frame_rate }: DashSetup): number {
  return Math.max(1, Math.round(segment_s * frame_rate));
}

function sentence({ setup, player, adaptive }: DashPlan): string {
  const { segment_s, frames_per_chunk, target_latency_ms, frame_rate } = setup;
  const chunk = frames_per_chunk === 1 ? "one frame" : `${Math.round((frames_per_chunk * 1000) / frame_rate)} ms`;
  const by = player === "mse" ? "a minimal player" : player;
  const more = adaptive ? ", raised when playback stalls" : "";
  return `Segments of ${segment_s} s in chunks of ${chunk}, played by ${by}; target latency ${target_latency_ms} ms${more}.`;
}
