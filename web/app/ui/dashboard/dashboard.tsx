/** All scenes on the server, to find, load and open. */
import { RefreshCw, Search, Upload } from "lucide";
import { useEffect, useRef, useState } from "preact/hooks";
import type { SceneInfo } from "#client/wire/render";
import { config, refreshScenes, scenes, scenesError, settings } from "../../state/app";
import { EXPERIMENTS } from "../../state/route";
import { added, addFiles, uploads } from "../../uploads/uploads";
import { Icon, IconButton } from "../button";
import { usePage, useWindowEvent } from "../hooks";
import { lazy } from "../lazy";
import { InsecureHint, Notice } from "../notice";
import { TopBar } from "../top-bar";
import { DropZone } from "./drop-zone";
import { filterScenes } from "./filter";
import { whatIsNew } from "./news";
import { SceneCard, SkeletonCard } from "./scene-card";

const NoMatch = lazy(async () => (await import("./empty")).NoMatch);
const NoScenes = lazy(async () => (await import("./empty")).NoScenes);
const UploadCard = lazy(async () => (await import("./upload-card")).UploadCard, { quiet: true });
const RenameQuestion = lazy(async () => (await import("./questions")).RenameQuestion);
const DeleteQuestion = lazy(async () => (await import("./questions")).DeleteQuestion);

/** Interval of refreshing the list while a scene loads or the server is unreachable, in milliseconds. */
const REFRESH_EVERY = 1000;
/** Display time of a rescan's result, in milliseconds. */
const NEWS_FOR = 10_000;

export function Dashboard() {
  const [filter, setFilter] = useState("");
  const [scanning, setScanning] = useState(false);
  const [news, setNews] = useState("");
  const [question, setQuestion] = useState<{ readonly kind: "rename" | "delete"; readonly scene: SceneInfo }>();
  const search = useRef<HTMLInputElement>(null);
  const files = useRef<HTMLInputElement>(null);
  /** Whether a scene was loaded for its picture since the list was fetched. */
  const stale = useRef(false);

  usePage("Scenes");
  useEffect(() => {
    if (scanning) return undefined; // a list fetched meanwhile may be older than the scan's and would replace it
    const timer = setInterval(() => {
      const waiting = scenesError.value !== null || scenes.value?.some(({ state }) => state === "loading");
      if (!document.hidden && (waiting || stale.current)) void refreshScenes();
      stale.current = false;
    }, REFRESH_EVERY);
    return () => clearInterval(timer);
  }, [scanning]);
  useWindowEvent("keydown", (event) => {
    if (event.key !== "/" || event.target instanceof HTMLInputElement || !settings.peek().shortcuts) return;
    event.preventDefault();
    search.current?.focus();
  });

  useEffect(() => {
    if (news === "") return undefined;
    const timer = setTimeout(() => setNews(""), NEWS_FOR);
    return () => clearTimeout(timer);
  }, [news]);

  const rescan = async () => {
    const before = scenes.peek();
    setScanning(true);
    const found = await refreshScenes({ scan: true });
    setScanning(false);
    setNews(before && found ? whatIsNew(before, found) : "");
  };

  const limit = config.value?.max_upload_bytes ?? null;
  const add = (chosen: Iterable<File>) => limit !== null && addFiles([...chosen], limit);
  const ask = (kind: "rename" | "delete", scene: SceneInfo) => {
    return limit === null || scene.builtin ? null : () => setQuestion({ kind, scene });
  };
  const answered = () => setQuestion(undefined);

  const all = scenes.value;
  const isAdded = ({ id }: SceneInfo) => added.value.has(id);
  const found = all && filterScenes(all, filter).toSorted((a, b) => Number(isAdded(b)) - Number(isAdded(a)));

  return (
    <div class="dashboard">
      <TopBar>{config.value?.services.store && <a href={EXPERIMENTS}>Experiments</a>}</TopBar>
      <main>
        <div class="page-head row wrap spread">
          <div>
            <h1>Scenes</h1>
            <p class="muted" role="status">
              {summary(all?.length, found?.length)}
              {news && ` · ${news}`}
            </p>
          </div>
          <search class="tools row">
            <label class="search-field row">
              <Icon of={Search} size={16} />
              <input
                ref={search}
                type="search"
                aria-label="Filter scenes by name"
                aria-keyshortcuts="/"
                placeholder="Filter scenes"
                value={filter}
                onInput={(event) => setFilter(event.currentTarget.value)}
              />
              <kbd>/</kbd>
            </label>
            {limit !== null && (
              <>
                <button type="button" class="button with-icon" onClick={() => files.current?.click()}>
                  <Icon of={Upload} size={16} /> Add scenes
                </button>
                <input
                  ref={files}
                  type="file"
                  hidden
                  multiple
                  aria-label="Scene files"
                  onChange={({ currentTarget }) => {
                    add(currentTarget.files ?? []);
                    currentTarget.value = ""; // so that the same file can be chosen again
                  }}
                />
              </>
            )}
            <IconButton
              icon={RefreshCw}
              label="Rescan folder"
              busy={scanning}
              disabled={scanning}
              onClick={() => void rescan()}
            />
          </search>
        </div>
        <InsecureHint />
        <Notice>{scenesError.value}</Notice>
        {uploads.value.length > 0 && (
          <ul class="scene-grid uploads" aria-label="Uploads">
            {uploads.value.map((upload) => (
              <UploadCard key={upload.number} upload={upload} />
            ))}
          </ul>
        )}
        {found?.length === 0 ? (
          all?.length === 0 ? (
            <NoScenes editable={limit !== null} />
          ) : (
            <NoMatch filter={filter} />
          )
        ) : (
          <ul class="scene-grid" aria-busy={all === null}>
            {found
              ? found.map((scene) => (
                  <SceneCard
                    key={scene.id}
                    scene={scene}
                    added={isAdded(scene)}
                    onRendered={() => {
                      stale.current ||= scene.state === "unloaded";
                    }}
                    onRename={ask("rename", scene)}
                    onDelete={ask("delete", scene)}
                  />
                ))
              : [0, 1, 2].map((place) => <SkeletonCard key={place} />)}
          </ul>
        )}
      </main>
      <DropZone allowed={limit !== null} onFiles={add} />
      {question?.kind === "rename" && <RenameQuestion scene={question.scene} onClose={answered} />}
      {question?.kind === "delete" && <DeleteQuestion scene={question.scene} onClose={answered} />}
      <footer class="muted">{config.value && `TIGAS ${config.value.version}`}</footer>
    </div>
  );
}

function summary(all: number | undefined, found: number | undefined): string {
  if (all === undefined || found === undefined) return "Loading scenes…";
  const scenes = all === 1 ? "1 scene" : `${all} scenes`;
  return found === all ? `${scenes} on this server` : `${found} of ${scenes}`;
}
