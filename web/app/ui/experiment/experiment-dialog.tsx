/** The dialog that starts an experiment in the viewer's scene. */

import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useMemo } from "preact/hooks";
import type { Draft } from "#lab/experiment/file";
import { StoreApi } from "#lab/experiment/store-api";
import type { ViewerSession } from "#viewer/session/session";
import { config, settings } from "../../state/app";
import { runHash } from "../../state/route";
import { Dialog } from "../dialog";
import { useShaper } from "../network/use-shaper";
import { keyOf } from "../use-movements";
import { ExperimentForm } from "./experiment-form";

interface Props {
  readonly session: ViewerSession;
  readonly open: Signal<boolean>;
}

export function ExperimentDialog({ session, open }: Props) {
  const base = config.value?.services.store;
  const store = useMemo(() => (base === undefined ? null : new StoreApi(base)), [base]);
  const shaper = useShaper(config.value?.services.shaper, open.value);
  const draft = useSignal<Draft | null>(null);
  const { name = "" } = session.scene.value ?? {};
  useEffect(() => {
    if (open.value) draft.value ??= initialDraft(session);
    if (draft.value?.name === "") draft.value = { ...draft.value, name }; // the scene may arrive after the dialog has opened
  }, [open.value, draft, session, name]);
  if (!open.value || draft.value === null) return null;
  return (
    <Dialog
      title="Experiment"
      kind="experiment"
      onClose={() => {
        open.value = false;
      }}
    >
      {store === null ? (
        <p>
          Experiments need a store, and this server has none. Start one with <code>tigas store</code>.
        </p>
      ) : (
        <ExperimentForm
          session={session}
          shaper={shaper}
          store={store}
          draft={draft.value}
          onDraft={(filled) => {
            draft.value = filled;
          }}
          onStart={(id) => {
            location.hash = runHash(id);
          }}
        />
      )}
    </Dialog>
  );
}

/** Initial values of the form: reprojection and prediction as in the viewer. */
function initialDraft({ scene, movement, unturned }: ViewerSession): Draft {
  const chosen = movement.movement.peek();
  const { reprojection, prediction } = settings.peek();
  return {
    name: scene.peek()?.name ?? "",
    movement: chosen && keyOf(chosen),
    trace: null,
    rtt: "",
    modes: ["stateless"],
    controllers: ["latency", "seen"],
    reprojection: reprojection && unturned.peek() === null,
    prediction,
    segments: "1",
    repeats: "1",
    duration: "20",
    stride: "0",
  };
}
