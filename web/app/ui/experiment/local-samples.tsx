/** Samples that only this browser has: uploaded later, or deleted. */
import { useSignal } from "@preact/signals";
import { Trash2, Upload } from "lucide";
import { useCallback, useEffect, useRef } from "preact/hooks";
import { ApiError } from "#client/http/problem";
import { deleteSamples, uploadSamples } from "#lab/experiment/sample-upload";
import type { StoreApi } from "#lab/experiment/store-api";
import { listSampledRuns, type SampledRun } from "#lab/samples/sampled-runs";
import { bytes } from "../format";
import { Icon } from "../icon";
import { Question } from "../question";

interface Props {
  /** Null without a store. */
  readonly store: StoreApi | null;
  /** Samples were uploaded to the store. */
  readonly onUploaded: () => void;
}

export function LocalSamples({ store, onUploaded }: Props) {
  const runs = useSignal<readonly SampledRun[]>([]);
  const problem = useSignal<string | null>(null);
  const unwanted = useSignal<SampledRun | null>(null);
  const look = useCallback(async () => {
    runs.value = await listSampledRuns();
  }, [runs]);
  useEffect(() => {
    void look();
    const onFocus = () => void look(); // another tab may have deleted or uploaded some
    addEventListener("focus", onFocus);
    return () => removeEventListener("focus", onFocus);
  }, [look]);
  const done = async (work: Promise<void>) => {
    problem.value = null;
    try {
      await work;
      onUploaded();
    } catch (error) {
      problem.value = error instanceof ApiError ? error.message : `The page failed: ${error}`;
    }
    await look();
  };
  const answered = () => {
    unwanted.value = null;
  };
  if (runs.value.length === 0) return null;
  return (
    <section class="local-samples" aria-labelledby="local-samples">
      <h2 id="local-samples">Samples in this browser</h2>
      <p class="muted">Shown frames that experiments kept here, and that no store has yet.</p>
      {problem.value && (
        <p class="notice" role="alert">
          {problem.value}
        </p>
      )}
      <div class="experiment-list">
        <table>
          <thead>
            <tr>
              <th scope="col">Run</th>
              <th scope="col">Samples</th>
              <th scope="col">Size</th>
              <th scope="col">
                <span class="visually-hidden">Actions</span>
              </th>
            </tr>
          </thead>
          <tbody>
            {runs.value.map((run) => (
              <Row
                key={run.key}
                run={run}
                store={store}
                onDone={done}
                onDelete={() => {
                  unwanted.value = run;
                }}
              />
            ))}
          </tbody>
        </table>
      </div>
      {unwanted.value && <DeleteQuestion run={unwanted.value} onDone={done} onClose={answered} />}
    </section>
  );
}

interface DeleteProps extends Pick<RowProps, "run" | "onDone"> {
  readonly onClose: () => void;
}

function DeleteQuestion({ run, onDone, onClose }: DeleteProps) {
  return (
    <Question
      title={`Delete the samples of “${nameOf(run)}”?`}
      verb="Delete"
      action={() => onDone(deleteSamples(run.key))}
      onClose={onClose}
    >
      <p>No store has them. This cannot be undone.</p>
    </Question>
  );
}

interface RowProps {
  readonly run: SampledRun;
  readonly store: StoreApi | null;
  readonly onDone: (work: Promise<void>) => Promise<void>;
  readonly onDelete: () => void;
}

function Row({ run, store, onDone, onDelete }: RowProps) {
  const { key, about, samples, busy } = run;
  const sent = useSignal<number | null>(null);
  const leaving = useRef(new AbortController());
  useEffect(() => () => leaving.current.abort(), []);
  const upload = async () => {
    if (store === null) return;
    sent.value = 0;
    const progress = (now: number) => {
      sent.value = now;
    };
    await onDone(uploadSamples({ key, store, progress, signal: leaving.current.signal }));
    sent.value = null;
  };
  return (
    <tr>
      <th scope="row">
        {nameOf(run)}
        {about && (
          <time class="muted small" dateTime={new Date(about.started_unix_ms).toISOString()}>
            {new Date(about.started_unix_ms).toLocaleString("en", { dateStyle: "medium", timeStyle: "short" })}
          </time>
        )}
      </th>
      <td>{samples.length}</td>
      <td>{bytes(run.bytes)}</td>
      <td>
        {sent.value !== null ? (
          <progress max={Math.max(1, run.bytes)} value={sent.value} aria-label="Uploaded" />
        ) : busy ? (
          <span class="muted">In use by another tab</span>
        ) : (
          <>
            {store && about && (
              <button type="button" class="quiet-button with-icon" onClick={() => void upload()}>
                <Icon of={Upload} size={14} /> Upload
              </button>
            )}
            <button type="button" class="quiet-button with-icon" onClick={onDelete}>
              <Icon of={Trash2} size={14} /> Delete
            </button>
          </>
        )}
      </td>
    </tr>
  );
}

function nameOf({ about }: SampledRun): string {
  return about ? `${about.experiment}, ${about.title}` : "Unknown";
}
