/** All experiments that the store keeps, the newest first, with their reports and archives. */
import { useSignal } from "@preact/signals";
import { Download, FileText } from "lucide";
import { useEffect } from "preact/hooks";
import { StoreApi } from "../experiment/store-api";
import { ApiError } from "../state/api";
import { config, refresh } from "../state/app";
import type { ExperimentSummary } from "../store-wire";
import { Icon } from "./icon";
import { ThemeButton } from "./theme-button";

export function ExperimentList() {
  const base = config.value?.services.store;
  useEffect(() => {
    document.title = "Experiments · TIGAS";
    void refresh();
  }, []);
  return (
    <div class="dashboard">
      <header class="top-bar">
        <a class="brand" href="#/">
          <img src="icon.svg" alt="" width="26" height="26" />
          TIGAS
        </a>
        <div class="top-links">
          <a href="#/">Scenes</a>
          <ThemeButton />
        </div>
      </header>
      <main>
        <div class="page-head">
          <h1>Experiments</h1>
        </div>
        {base ? <Kept base={base} /> : config.value && <p>This server has no store of experiments.</p>}
      </main>
    </div>
  );
}

function Kept({ base }: { base: string }) {
  const list = useSignal<readonly ExperimentSummary[] | null>(null);
  const silence = useSignal<string | null>(null);
  const store = new StoreApi(base);
  useEffect(() => {
    new StoreApi(base).list().then(
      (found) => {
        list.value = found;
      },
      (error: unknown) => {
        silence.value = error instanceof ApiError ? error.message : "The list cannot be read.";
      },
    );
  }, [base, list, silence]);
  if (silence.value) {
    return (
      <p class="notice" role="alert">
        {silence.value}
      </p>
    );
  }
  if (list.value === null) return <p class="muted">Asking the store…</p>;
  if (list.value.length === 0) return <p>There is none yet. Open a scene and press E to make one.</p>;
  return (
    <div class="experiment-list">
      <table>
        <thead>
          <tr>
            <th scope="col">Name</th>
            <th scope="col">Complete runs</th>
            <th scope="col">
              <span class="visually-hidden">Files</span>
            </th>
          </tr>
        </thead>
        <tbody>
          {list.value.map(({ id, name, created, runs, complete }) => (
            <tr key={id}>
              <th scope="row">
                {name}
                <time class="muted small" dateTime={created}>
                  {new Date(created).toLocaleString("en", { dateStyle: "medium", timeStyle: "short" })}
                </time>
              </th>
              <td>{complete === runs ? runs : `${complete} of ${runs}`}</td>
              <td>
                <a class="with-icon" href={store.reportUrl(id)} target="_blank" rel="noreferrer">
                  <Icon of={FileText} size={14} /> Report
                </a>
                <a class="with-icon" href={store.zipUrl(id)} download>
                  <Icon of={Download} size={14} /> ZIP
                </a>
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}
