/** Setup of an experiment: movement, network, compared modes or controllers, and repetitions. */

import { useSignal } from "@preact/signals";
import type { ComponentChildren, TargetedSubmitEvent } from "preact";
import { CONTROLLER_NAMES } from "../../abr/registry";
import { FRAME_RATES } from "../../dash/presets";
import { webgpuProblem } from "../../enhance/device";
import { KINDS, OFF } from "../../enhance/model/enhancer";
import { type Draft, type Lengths, parseDraft, toggled } from "../../experiment/draft";
import type { ResumedExperiment } from "../../experiment/experiment";
import { presentNetwork } from "../../experiment/link";
import {
  conditionLabel,
  type ExperimentPlan,
  isDash,
  isPerView,
  isStreamed,
  type Profile,
  runsOf,
  timeFor,
  UNSHAPED,
} from "../../experiment/plan";
import { MovementError } from "../../movement/movement";
import type { TimedPose } from "../../movement/playback";
import type { Shaper } from "../../network/shaper";
import { PREDICTOR_NAMES } from "../../predict/registry";
import { config, ladder, settings } from "../../state/app";
import { EXPERIMENTS } from "../../state/route";
import type { ViewerSession } from "../../viewer/session";
import { MODE_NAMES, MODES } from "../../wire/run";
import { KIND_NAMES, ModelOptions } from "../enhancement-models";
import { bitrate, clock } from "../format";
import { OverscanOptions, overscanOf } from "../overscans";
import { PredictionOptions } from "../predictions";
import { Select, TextField } from "./experiment-fields";
import { MovementChoice, useMovementOpening, useMovements } from "./experiment-movement";

/** Parameters of a new experiment. */
export interface ExperimentSetup {
  readonly plan: ExperimentPlan;
  /** The movement, in the scene's own frame. */
  readonly points: readonly TimedPose[];
  readonly locked: boolean;
  readonly exportAtEnd: boolean;
  /** Missing parts of an experiment being resumed. */
  readonly resumed?: ResumedExperiment;
}

interface Props {
  readonly session: ViewerSession;
  readonly shaper: Shaper | null;
  /** The store's URL. */
  readonly store: string | undefined;
  readonly draft: Draft;
  readonly onDraft: (draft: Draft) => void;
  readonly onStart: (setup: ExperimentSetup) => void;
}

export function ExperimentForm({ session, shaper, store, draft, onDraft, onStart }: Props) {
  const problems = useSignal<readonly string[]>([]);
  const opening = useMovementOpening(store);
  const list = useMovements(store);
  const scene = session.scene.value;
  const movement = list.listed.find(({ key }) => key === draft.movement) ?? list.listed[0];
  const set = (part: Partial<Draft>) => {
    onDraft({ ...draft, ...part });
    problems.value = [];
  };

  const submit = async (event: TargetedSubmitEvent<HTMLFormElement>) => {
    event.preventDefault();
    const parsed = parseDraft(
      { ...draft, movement: movement?.name ?? null },
      scene?.id ?? "",
      presentNetwork(shaper),
      lengths(shaper, movement?.duration),
    );
    problems.value = "problems" in parsed ? parsed.problems : [];
    if (scene === null) problems.value = [...problems.value, "The scene is not there yet."];
    const { locked, exportAtEnd } = draft;
    if (!("plan" in parsed) || scene === null || movement === undefined) return;
    try {
      const opened = await opening.open(movement, scene);
      if (opened === null) return;
      onStart({ plan: parsed.plan, points: opened.points, locked, exportAtEnd });
    } catch (error) {
      if (!(error instanceof MovementError)) throw error;
      problems.value = [error.message];
    }
  };

  const { name, segments, repeats, duration, seed, stride, locked, exportAtEnd } = draft;
  return (
    <form class="experiment-form" noValidate onSubmit={(event) => void submit(event)}>
      <TextField label="Name" value={name} wide onValue={(typed) => set({ name: typed })} />
      <MovementChoice
        list={list}
        chosen={movement?.key ?? null}
        onChoose={(movement) => set({ movement })}
        onProblem={(sentence) => {
          problems.value = [sentence];
        }}
      />
      <NetworkChoice shaper={shaper} draft={draft} onChange={set} />
      <ConditionChoice draft={draft} onChange={set} />
      <TextField
        label="Vary the movement"
        unit="parts"
        numeric
        value={segments}
        onValue={(typed) => set({ segments: typed })}
      />
      <TextField label="Runs of each" numeric value={repeats} onValue={(typed) => set({ repeats: typed })} />
      <TextField
        label="Each run lasts"
        unit="s"
        numeric
        value={duration}
        onValue={(typed) => set({ duration: typed })}
      />
      <TextField label="Seed" numeric value={seed} onValue={(typed) => set({ seed: typed })} />
      <TextField
        label="Save every n-th frame"
        unit="0 = off"
        numeric
        value={stride}
        disabled={!draft.modes.includes("stateless")}
        onValue={(typed) => set({ stride: typed })}
      />
      <Check checked={locked} onChange={() => set({ locked: !locked })}>
        Lock input: keys, pointers and buttons rest while it runs
      </Check>
      <Check checked={exportAtEnd} onChange={() => set({ exportAtEnd: !exportAtEnd })}>
        Save all files at the end
      </Check>
      <footer>
        <div class="problems" role="alert">
          {problems.value.map((sentence) => (
            <p key={sentence}>{sentence}</p>
          ))}
        </div>
        <p class="muted small" data-experiment="estimate">
          {estimate(draft, lengths(shaper, movement?.duration))}
          {!store && " There is no store: the results stay in this page until you save them."}
        </p>
        {store && (
          <a class="button quiet" href={EXPERIMENTS}>
            All experiments
          </a>
        )}
        <button type="submit" class="button" disabled={opening.busy}>
          Start
        </button>
      </footer>
    </form>
  );
}

interface PartProps {
  readonly draft: Draft;
  readonly onChange: (part: Partial<Draft>) => void;
}

function NetworkChoice({ shaper, draft, onChange }: PartProps & { readonly shaper: Shaper | null }) {
  const traces = shaper?.traces.value.filter(({ error }) => !error) ?? [];
  const known = draft.trace === null || traces.some(({ name }) => name === draft.trace);
  return (
    <>
      <Select
        label="Network"
        value={draft.trace ?? ""}
        onValue={(value) => onChange({ trace: value === "" ? null : value })}
        note={shaper?.connectionError.value ?? (shaper === null ? "There is no shaper behind this page." : undefined)}
      >
        <option value="">Current link</option>
        {!known && <option value={draft.trace ?? ""}>{draft.trace}</option>}
        {traces.map(({ name, mean_down_kbps = 0 }) => (
          <option key={name} value={name}>
            {name} · {bitrate(mean_down_kbps * 1000)}
          </option>
        ))}
      </Select>
      <TextField
        label="Round trip"
        unit="ms"
        numeric
        placeholder={draft.trace === null ? "current" : "the trace’s"}
        disabled={draft.trace === null}
        value={draft.trace === null ? "" : draft.rtt}
        onValue={(rtt) => onChange({ rtt })}
      />
    </>
  );
}

function ConditionChoice({ draft, onChange }: PartProps) {
  const streams = Boolean(config.value?.services.dash);
  const rung = Math.min(settings.value.profile, ladder.value.length - 1);
  const profiles = [...new Set<Profile>([...CONTROLLER_NAMES, rung, ...draft.profiles])]; // hidden options are never selected
  const perView = draft.modes.some(isPerView);
  return (
    <>
      <fieldset>
        <legend>Modes</legend>
        {MODES.map((mode) => (
          <Check
            key={mode}
            checked={draft.modes.includes(mode)}
            disabled={isStreamed(mode) && !streams}
            onChange={() => onChange({ modes: toggled(draft.modes, mode, MODES) })}
          >
            {MODE_NAMES[mode]}
          </Check>
        ))}
        {!streams && <p class="muted small">This server has no packager for DASH and WebRTC streams.</p>}
      </fieldset>
      <Select
        label="DASH frame rate"
        value={String(draft.frameRate ?? "")}
        disabled={!draft.modes.some(isDash)}
        onValue={(value) => onChange({ frameRate: FRAME_RATES.find((rate) => String(rate) === value) ?? null })}
      >
        <option value="">the preset’s own</option>
        {FRAME_RATES.map((rate) => (
          <option key={rate} value={rate}>
            {rate} /s
          </option>
        ))}
      </Select>
      <Check checked={draft.reprojection} onChange={() => onChange({ reprojection: !draft.reprojection })}>
        Reprojection
      </Check>
      <Select
        label="Prediction"
        value={draft.prediction}
        onValue={(name) => onChange({ prediction: PREDICTOR_NAMES.find((one) => one === name) ?? OFF })}
      >
        <PredictionOptions />
      </Select>
      <Select
        label="Overscan"
        value={String(draft.overscan)}
        disabled={!draft.reprojection}
        onValue={(value) => onChange({ overscan: overscanOf(value) })}
      >
        <OverscanOptions chosen={draft.overscan} />
      </Select>
      <Check
        checked={draft.depth}
        disabled={!(draft.reprojection && draft.modes.includes("stateless"))}
        onChange={() => onChange({ depth: !draft.depth })}
      >
        Depth, stateless
      </Check>
      <Check
        checked={draft.surround}
        disabled={!(draft.reprojection && perView)}
        onChange={() => onChange({ surround: !draft.surround })}
      >
        Surround, stateless and video
      </Check>
      {KINDS.map((kind) => (
        <Select
          key={kind}
          label={`${KIND_NAMES[kind]}, stateless and video`}
          value={draft[kind]}
          disabled={!perView || webgpuProblem() !== null}
          onValue={(name) => onChange({ [kind]: name })}
          note={kind === "upscale" ? (webgpuProblem() ?? undefined) : undefined}
        >
          <ModelOptions kind={kind} />
        </Select>
      ))}
      <fieldset disabled={!perView}>
        <legend>Controllers, stateless and video</legend>
        {profiles.map((profile) => (
          <Check
            key={profile}
            checked={draft.profiles.includes(profile)}
            onChange={() => onChange({ profiles: toggled(draft.profiles, profile, profiles) })}
          >
            {conditionLabel({ mode: "stateless", profile }, ladder.value)}
          </Check>
        ))}
      </fieldset>
    </>
  );
}

interface CheckProps {
  readonly checked: boolean;
  readonly disabled?: boolean;
  readonly onChange: () => void;
  readonly children: ComponentChildren;
}

function Check({ checked, disabled, onChange, children }: CheckProps) {
  return (
    <label class="check">
      <input type="checkbox" checked={checked} disabled={disabled} onChange={onChange} />
      <span>{children}</span>
    </label>
  );
}

/** Of the chosen movement, which is as long as it takes where none is chosen, and of the shaper's traces. */
function lengths(shaper: Shaper | null, movement = Number.POSITIVE_INFINITY): Lengths {
  const traces = shaper?.traces.value ?? [];
  return { movement, traces: Object.fromEntries(traces.map(({ name, duration_ms = 0 }) => [name, duration_ms])) };
}

/** How many runs it is, and how long they take. */
function estimate(draft: Draft, lengths: Lengths): string {
  const parsed = parseDraft({ ...draft, name: "x", movement: "x" }, "", UNSHAPED, lengths);
  if ("problems" in parsed) return "";
  const runs = runsOf(parsed.plan).length;
  const short = lengths.movement < parsed.plan.duration_s * 1000 ? " The movement ends before a run does." : "";
  return `${runs} ${runs === 1 ? "run" : "runs"}, about ${clock(timeFor(parsed.plan, runs))} min.${short}`;
}
