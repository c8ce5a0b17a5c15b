/** One scene in the list: its picture, facts about it, and whether it is in memory. */
import { ImageOff, Pencil, Trash2 } from "lucide";
import { useState } from "preact/hooks";
import type { SceneInfo } from "#client/wire/render";
import { setSceneLoaded } from "../../state/app";
import { sceneHash } from "../../state/route";
import { Icon, IconButton, QuietButton } from "../button";
import { bytes, count } from "../format";

const STATES: Record<SceneInfo["state"], string> = {
  unloaded: "Not loaded",
  loading: "Loading…",
  loaded: "In memory",
  broken: "Broken",
};

interface Props {
  readonly scene: SceneInfo;
  /** Whether it was added from this page and not opened since. */
  readonly added: boolean;
  /** Called when the server has rendered its picture, for which it loads the scene. */
  readonly onRendered: () => void;
  /** Null where scenes cannot be changed. */
  readonly onRename: (() => void) | null;
  readonly onDelete: (() => void) | null;
}

export function SceneCard({ scene, added, onRendered, onRename, onDelete }: Props) {
  const broken = scene.state === "broken";
  return (
    <li class="card" data-scene={scene.id} data-state={scene.state} data-added={added}>
      <Thumbnail key={String(broken)} scene={scene} onRendered={onRendered} />
      <div class="card-body">
        <div class="card-head">
          <h2>{broken ? scene.name : <a href={sceneHash(scene.id)}>{scene.name}</a>}</h2>
          {onRename && <IconButton icon={Pencil} label={`Rename: ${scene.name}`} onClick={onRename} />}
          {onDelete && <IconButton icon={Trash2} label={`Delete: ${scene.name}`} onClick={onDelete} />}
        </div>
        {broken ? <p class="card-error">{scene.error}</p> : <p class="muted facts">{facts(scene)}</p>}
        {added && !broken && (
          <p class="facts">
            Just added · <a href={sceneHash(scene.id)}>Open</a>
          </p>
        )}
      </div>
      <div class="card-foot row spread small">
        <span class="state" data-state={scene.state}>
          {STATES[scene.state]}
          {scene.state === "loaded" && <span class="muted"> · {bytes(scene.memory_bytes)}</span>}
        </span>
        {scene.state === "loading" && (
          <progress max={1} value={scene.progress ?? 0} aria-label={`Loading ${scene.name}`} />
        )}
        <LoadButton scene={scene} />
      </div>
    </li>
  );
}

function LoadButton({ scene }: { scene: SceneInfo }) {
  const loaded = scene.state === "loaded";
  const verb = loaded ? "Unload" : scene.state === "broken" ? "Try again" : "Load";
  return (
    <QuietButton
      aria-label={`${verb}: ${scene.name}`}
      disabled={scene.state === "loading"}
      onClick={() => void setSceneLoaded(scene, !loaded)}
    >
      {verb}
    </QuietButton>
  );
}

/** The preview; the server may take seconds to render it the first time. */
function Thumbnail({ scene, onRendered }: Pick<Props, "scene" | "onRendered">) {
  const [state, setState] = useState<"waiting" | "there" | "missing">(scene.state === "broken" ? "missing" : "waiting");
  return (
    <div class="thumbnail" data-state={state}>
      {state === "missing" ? (
        <Icon of={ImageOff} size={28} />
      ) : (
        <img
          src={scene.preview.replace(/^\//, "")}
          alt=""
          loading="lazy"
          decoding="async"
          onLoad={() => {
            setState("there");
            onRendered();
          }}
          onError={() => setState("missing")}
        />
      )}
    </div>
  );
}

function facts(scene: SceneInfo): string {
  const parts = [
    scene.gaussians !== null && `${count(scene.gaussians)} Gaussians`,
    scene.file_bytes > 0 && [scene.format, bytes(scene.file_bytes)].filter(Boolean).join(" "),
    scene.sh_degree !== null && `SH degree ${scene.sh_degree}`,
  ];
  return parts.filter(Boolean).join(" · ");
}

export function SkeletonCard() {
  return (
    <li class="card skeleton" aria-hidden="true">
      <div class="thumbnail" data-state="waiting" />
      <div class="card-body">
        <span class="bone" />
        <span class="bone" />
      </div>
    </li>
  );
}
