/** Setup of an experiment: a short form that writes its file, which the store expands. */

import { useSignal } from "@preact/signals";
import type { TargetedSubmitEvent } from "preact";
import { useEffect, useMemo, useState } from "preact/hooks";
import { CONTROLLER_NAMES, CONTROLLERS } from "#client/abr/registry";
import { MODE_NAMES, MODES } from "#client/wire/run";
import type { ExperimentRequest } from "#client/wire/store";
import { type Draft, experimentFile, isPerView, isStreamed, type Profile, toggled } from "#lab/experiment/file";
import { presentNetwork } from "#lab/experiment/link";
import type { StoreApi } from "#lab/experiment/store-api";
import type { Shaper } from "#lab/network/shaper";
import type { ViewerSession } from "#viewer/session/session";
import { SETTINGS } from "#viewer/state/settings";
import { config, ladder, settings } from "../../state/app";
import { EXPERIMENTS } from "../../state/route";
import { QuietButton } from "../button";
import { Check, Select, TextField } from "../fields";
import { bitrate } from "../format";
import { reason } from "../hooks";
import { useMovements } from "../use-movements";
import { MovementChoice, movementFile } from "./experiment-movement";

interface Props {
  readonly session: ViewerSession;
  readonly shaper: Shaper | null;
  readonly store: StoreApi;
  readonly draft: Draft;
  readonly onDraft: (draft: Draft) => void;
  /** Receives the id of the experiment. */
  readonly onStart: (id: string) => void;
}

/** Idle time after which a changed form is expanded, in milliseconds. */
const EXPAND_AFTER = 300;

export function ExperimentForm({ session, shaper, store, draft, onDraft, onStart }: Props) {
  const [problem, setProblem] = useState<string | null>(null);
  const [busy, setBusy] = useState(false);
  /** An edited file, which replaces the form's. */
  const [edited, setEdited] = useState<string | null>(null);
  const list = useMovements(store.base);
  const movement = list.listed.find(({ key }) => key === draft.movement) ?? list.listed[0];
  const set = (part: Partial<Draft>) => {
    onDraft({ ...draft, ...part });
    setProblem(null);
  };
  const present = presentNetwork(shaper);
  const { name = "", text = null } = movement ? movementFile(movement) : {};
  const written = experimentFile(draft, {
    scene: session.scene.value?.id ?? "",
    movement: name,
    present: "label" in present ? present.label : "",
    settings: settings.value,
    viewport: { width: innerWidth, height: innerHeight },
  });
  const file = edited ?? written;
  const request: ExperimentRequest = {
    file,
    movements: text === null ? {} : { [name]: text },
    traces_s: traceDurations(shaper),
  };
  const obstacle =
    edited !== null
      ? null
      : movement === undefined
        ? "Choose a movement."
        : draft.trace === null && "problem" in present
          ? present.problem
          : null;
  const summary = useSummary(store, obstacle === null ? request : null);

  const submit = async (event: TargetedSubmitEvent<HTMLFormElement>) => {
    event.preventDefault();
    setProblem(obstacle);
    if (obstacle !== null) return;
    setBusy(true);
    try {
      onStart(await store.create(request));
    } catch (error) {
      setProblem(reason(error));
    }
    setBusy(false);
  };

  return (
    <form class="experiment-form" noValidate onSubmit={(event) => void submit(event)}>
      <fieldset disabled={edited !== null} data-wide class="experiment-fields columns">
        <TextField label="Name" value={draft.name} wide onValue={(typed) => set({ name: typed })} />
        <MovementChoice
          list={list}
          chosen={movement?.key ?? null}
          onChoose={(movement) => set({ movement })}
          onProblem={setProblem}
        />
        <NetworkChoice shaper={shaper} draft={draft} onChange={set} />
        <ConditionChoice draft={draft} onChange={set} />
        <TextField
          label="Movement segments"
          numeric
          value={draft.segments}
          onValue={(typed) => set({ segments: typed })}
        />
        <TextField label="Repeats" numeric value={draft.repeats} onValue={(typed) => set({ repeats: typed })} />
        <TextField
          label="Run duration"
          unit="s"
          numeric
          value={draft.duration}
          onValue={(typed) => set({ duration: typed })}
        />
        <TextField
          label="Save every nth frame"
          unit="0 = off"
          numeric
          value={draft.stride}
          disabled={!draft.modes.includes("stateless")}
          onValue={(typed) => set({ stride: typed })}
        />
      </fieldset>
      <details data-wide>
        <summary>Edit as a file</summary>
        <textarea
          aria-label="Experiment file"
          spellcheck={false}
          rows={12}
          value={file}
          onInput={({ currentTarget }) => {
            setEdited(currentTarget.value);
            setProblem(null);
          }}
        />
        <p class="muted small">
          TOML or JSON, as for <code>tigas experiment run</code>.{" "}
          {edited !== null && <QuietButton onClick={() => setEdited(null)}>Back to the form</QuietButton>}
        </p>
      </details>
      <footer class="row wrap">
        <div class="problems" role="alert">
          {problem && <p>{problem}</p>}
        </div>
        <p class="muted small" data-experiment="estimate">
          {problem === null && summary}
        </p>
        <a class="button quiet" href={EXPERIMENTS}>
          All experiments
        </a>
        <button type="submit" class="button" disabled={busy}>
          Start
        </button>
      </footer>
    </form>
  );
}

/** Number and duration of the runs, or the problem, in one sentence. */
function useSummary(store: StoreApi, request: ExperimentRequest | null): string {
  const said = useSignal("");
  const key = JSON.stringify(request);
  useEffect(() => {
    said.value = "";
    if (key === "null") return undefined;
    const outdated = new AbortController();
    const expand = async () => {
      try {
        const { runs, lasting, problem } = await store.summary(JSON.parse(key) as ExperimentRequest, outdated.signal);
        said.value = problem ?? `${runs} ${runs === 1 ? "run" : "runs"}, about ${lasting}.`;
      } catch (error) {
        if (!outdated.signal.aborted) said.value = reason(error);
      }
    };
    const timer = setTimeout(() => void expand(), EXPAND_AFTER);
    return () => {
      clearTimeout(timer);
      outdated.abort();
    };
  }, [store, key, said]);
  return said.value;
}

function traceDurations(shaper: Shaper | null): Record<string, number> {
  const traces = shaper?.traces.value ?? [];
  return Object.fromEntries(
    traces.flatMap(({ name, duration_ms }) => (duration_ms ? [[name, duration_ms / 1000]] : [])),
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
        options={[
          ["", "Current link"],
          ...(known ? [] : [[draft.trace ?? "", draft.trace ?? ""] as const]),
          ...traces.map(
            ({ name, mean_down_kbps = 0 }) => [name, `${name} · ${bitrate(mean_down_kbps * 1000)}`] as const,
          ),
        ]}
        onValue={(value) => onChange({ trace: value === "" ? null : value })}
        note={shaper === null ? "This server has no network shaper." : shaper.connectionError.value}
      />
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
  const controllers = useMemo<Profile[]>(() => [...CONTROLLER_NAMES, Math.max(0, rung)], [rung]);
  return (
    <>
      <fieldset>
        <legend class="small">Modes</legend>
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
      </fieldset>
      <fieldset disabled={!draft.modes.some(isPerView)}>
        <legend class="small">Controllers for stateless and video</legend>
        {controllers.map((controller) => (
          <Check
            key={controller}
            checked={draft.controllers.includes(controller)}
            onChange={() => onChange({ controllers: toggled(draft.controllers, controller, controllers) })}
          >
            {titleOf(controller)}
          </Check>
        ))}
      </fieldset>
      <Check checked={draft.reprojection} onChange={() => onChange({ reprojection: !draft.reprojection })}>
        Reprojection
      </Check>
      <Select
        label="Prediction"
        value={draft.prediction}
        options={Object.entries(SETTINGS.prediction.options)}
        onValue={(name) => onChange({ prediction: name as Draft["prediction"] })}
      />
    </>
  );
}

function titleOf(controller: Profile): string {
  if (typeof controller === "number") return `Fixed: ${ladder.value[controller]?.name ?? `profile ${controller}`}`;
  return (CONTROLLERS as Readonly<Record<string, { readonly title: string }>>)[controller]?.title ?? controller;
}
