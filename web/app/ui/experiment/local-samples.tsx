/** Samples that only this browser has, to be uploaded or deleted. */
import { Trash2, Upload } from "lucide";
import { useCallback, useEffect, useRef, useState } from "preact/hooks";
import { deleteSamples, uploadSamples } from "#lab/experiment/sample-upload";
import type { StoreApi } from "#lab/experiment/store-api";
import { listSampledRuns, type SampledRun } from "#lab/samples/sampled-runs";
import { QuietButton } from "../button";
import { bytes } from "../format";
import { useAttempts, useWindowEvent } from "../hooks";
import { Notice } from "../notice";
import { Question } from "../question";
import { dateOf, Table } from "./table";

interface Props {
  /** Null without a store. */
  readonly store: StoreApi | null;
  /** Called when samples were uploaded to the store. */
  readonly onUploaded: () => void;
}

export function LocalSamples({ store, onUploaded }: Props) {
  const [runs, setRuns] = useState<readonly SampledRun[]>([]);
  const [unwanted, setUnwanted] = useState<SampledRun>();
  const { problem, attempt } = useAttempts();
  const look = useCallback(async () => setRuns(await listSampledRuns()), []);
  useEffect(() => void look(), [look]);
  useWindowEvent("focus", () => void look()); // another tab may have deleted or uploaded some
  const done = async (work: Promise<void>) => {
    if (await attempt(() => work)) onUploaded();
    await look();
  };
  if (runs.length === 0) return null;
  return (
    <section class="local-samples stack" aria-labelledby="local-samples">
      <h2 id="local-samples">Samples in this browser</h2>
      <p class="muted">Frames that experiments saved in this browser and that have not been uploaded to a store yet.</p>
      <Notice>{problem.value}</Notice>
      <Table columns={["Run", "Samples", "Size", null]}>
        {runs.map((run) => (
          <Row key={run.key} run={run} store={store} onDone={done} onDelete={() => setUnwanted(run)} />
        ))}
      </Table>
      {unwanted && (
        <Question
          title={`Delete the samples of “${nameOf(unwanted)}”?`}
          verb="Delete"
          action={() => done(deleteSamples(unwanted.key))}
          onClose={() => setUnwanted(undefined)}
        >
          <p>They have not been uploaded to a store. This cannot be undone.</p>
        </Question>
      )}
    </section>
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
  const [sent, setSent] = useState<number | null>(null);
  const leaving = useRef(new AbortController());
  useEffect(() => () => leaving.current.abort(), []);
  const upload = async () => {
    if (store === null) return;
    setSent(0);
    await onDone(uploadSamples({ key, store, progress: setSent, signal: leaving.current.signal }));
    setSent(null);
  };
  return (
    <tr>
      <th scope="row">
        {nameOf(run)}
        {about && (
          <time class="muted small" dateTime={new Date(about.started_unix_ms).toISOString()}>
            {dateOf(about.started_unix_ms)}
          </time>
        )}
      </th>
      <td>{samples.length}</td>
      <td>{bytes(run.bytes)}</td>
      <td>
        {sent !== null ? (
          <progress max={Math.max(1, run.bytes)} value={sent} aria-label="Upload progress" />
        ) : busy ? (
          <span class="muted">In use by another tab</span>
        ) : (
          <>
            {store && about && (
              <QuietButton icon={Upload} onClick={() => void upload()}>
                Upload
              </QuietButton>
            )}
            <QuietButton icon={Trash2} onClick={onDelete}>
              Delete
            </QuietButton>
          </>
        )}
      </td>
    </tr>
  );
}

function nameOf({ about }: SampledRun): string {
  return about ? `${about.experiment}, ${about.title}` : "Unknown";
}
