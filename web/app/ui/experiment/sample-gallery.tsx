/**
 * The samples of a run: received frame, shown frame and ground truth in a row, a slider between two, and differences.
 */
import { useSignal } from "@preact/signals";
import { useEffect, useMemo, useState } from "preact/hooks";
import type { SampleRow } from "#client/wire/store";
import { reason } from "../hooks";
import { Notice } from "../notice";

const PICTURES = {
  original: "Received",
  enhanced: "Enhanced",
  truth: "Ground truth",
  replayed: "Re-rendered",
} as const;
type Picture = keyof typeof PICTURES;
const VIEWS = {
  ...PICTURES,
  "original-difference": "Received, difference × 4",
  "enhanced-difference": "Enhanced, difference × 4",
} as const;
type View = keyof typeof VIEWS;
type Urls = Readonly<Partial<Record<Picture, string>>>;

interface Props {
  readonly samples: readonly SampleRow[];
  readonly load: (name: string) => Promise<Blob>;
}

export function SampleGallery({ samples, load }: Props) {
  const [chosen, setChosen] = useState(0);
  const index = Math.min(chosen, samples.length - 1);
  const sample = samples[index];
  if (sample === undefined) return <p>This run has no samples.</p>;
  const step = (label: string, to: number) => (
    <button type="button" class="button quiet" disabled={samples[to] === undefined} onClick={() => setChosen(to)}>
      {label}
    </button>
  );
  return (
    <section class="sample-gallery stack" aria-label="Samples">
      <div class="sample-choice row wrap">
        {step("Previous", index - 1)}
        <label>
          Sample{" "}
          <select value={sample.seq} onChange={({ currentTarget }) => setChosen(currentTarget.selectedIndex)}>
            {samples.map(({ seq, at }) => (
              <option key={seq} value={seq}>
                {seq}, at {(at / 1000).toFixed(1)} s
              </option>
            ))}
          </select>
        </label>
        {step("Next", index + 1)}
      </div>
      <Pictures key={sample.seq} sample={sample} load={load} />
    </section>
  );
}

function Pictures({ sample, load }: { sample: SampleRow; load: Props["load"] }) {
  const { urls, problem } = useUrls(sample, load);
  const [left, setLeft] = useState<View>(sample.enhanced ? "enhanced" : "original");
  const [right, setRight] = useState<View>("truth");
  const [at, setAt] = useState(50);
  const views = useMemo(() => viewsOf(sample), [sample]);
  const [ratio, setRatio] = useState(16 / 9);
  const choose = (label: string, view: View, set: (view: View) => void) => (
    <label>
      {label}{" "}
      <select value={view} onChange={({ currentTarget }) => set(currentTarget.value as View)}>
        {views.map((name) => (
          <option key={name} value={name}>
            {VIEWS[name]}
          </option>
        ))}
      </select>
    </label>
  );
  return (
    <>
      <Notice>{problem}</Notice>
      <p class="small muted">{about(sample)}</p>
      <Remarks sample={sample} />
      <div class="sample-choice row wrap">
        {choose("Left", left, setLeft)}
        {choose("Right", right, setRight)}
      </div>
      <div class="wipe-box" style={{ "--at": `${at}%`, "--ratio": ratio }}>
        <div class="wipe">
          <Layer view={right} urls={urls} />
          <div class="wipe-left">
            <Layer view={left} urls={urls} />
          </div>
        </div>
        <input
          type="range"
          min="0"
          max="100"
          step="0.5"
          value={at}
          aria-label="Divider position"
          onInput={({ currentTarget }) => setAt(currentTarget.valueAsNumber)}
        />
      </div>
      <div class="sample-row columns">
        {(["original", "enhanced", "truth"] as const).map(
          (name) =>
            urls[name] && (
              <figure key={name}>
                <img
                  src={urls[name]}
                  alt={PICTURES[name]}
                  onLoad={({ currentTarget }) => setRatio(currentTarget.naturalWidth / currentTarget.naturalHeight)}
                />
                <figcaption class="small muted">{PICTURES[name]}</figcaption>
              </figure>
            ),
        )}
      </div>
    </>
  );
}

/** A picture, or its difference from ground truth, which the browser's compositor subtracts and multiplies. */
function Layer({ view, urls }: { view: View; urls: Urls }) {
  const [name, difference] = view.split("-") as [Picture, string?];
  const [url, truth] = [urls[name], urls.truth];
  if (!url || (difference && !truth)) return null;
  if (!difference) return <img class="layer" src={url} alt={VIEWS[view]} />;
  return (
    <div class="layer difference" role="img" aria-label={VIEWS[view]}>
      <img class="layer" src={url} alt="" />
      <img class="layer subtracted" src={truth} alt="" />
    </div>
  );
}

function Remarks({ sample: { identical, problem, truth } }: { sample: SampleRow }) {
  return (
    <>
      {identical === false && (
        <p class="sample-warning" role="alert">
          Rendering it again gave a different frame, so the ground truth may not match this one.
        </p>
      )}
      {truth === null && problem === null && <p class="small">Its ground truth has not been rendered yet.</p>}
      {problem && <p class="sample-warning">{problem}</p>}
    </>
  );
}

/** Object URLs of a sample's pictures, available once loaded; revoked on unmount. */
function useUrls(sample: SampleRow, load: Props["load"]): { urls: Urls; problem: string | null } {
  const urls = useSignal<Urls>({});
  const problem = useSignal<string | null>(null);
  const { original, enhanced, truth, replayed } = sample;
  useEffect(() => {
    let gone = false;
    const made: string[] = [];
    const take = async (picture: Picture, name: string | null) => {
      if (name === null) return;
      try {
        const blob = await load(name);
        if (gone) return;
        const url = URL.createObjectURL(blob);
        made.push(url);
        urls.value = { ...urls.value, [picture]: url };
      } catch (error) {
        problem.value = reason(error);
      }
    };
    const names = { original, enhanced, truth, replayed };
    for (const picture of Object.keys(PICTURES) as Picture[]) void take(picture, names[picture]);
    return () => {
      gone = true;
      for (const url of made) URL.revokeObjectURL(url);
      urls.value = {};
    };
  }, [original, enhanced, truth, replayed, load, urls, problem]);
  return { urls: urls.value, problem: problem.value };
}

function viewsOf(sample: SampleRow): View[] {
  const pictures = (Object.keys(PICTURES) as Picture[]).filter((name) => sample[name] !== null);
  if (sample.truth === null) return pictures;
  const compared = (["original", "enhanced"] as const).filter((name) => sample[name] !== null);
  return [...pictures, ...compared.map((name) => `${name}-difference` as const)];
}

function about({ rung, bytes, restore, upscale, enhance_ms }: SampleRow): string {
  const models = [restore, upscale].filter((name) => name !== "off");
  const parts = [
    `${(bytes / 1000).toFixed(1)} kB`,
    ...(rung === null ? [] : [`rung ${rung}`]),
    ...models,
    ...(enhance_ms === null ? [] : [`enhanced in ${enhance_ms.toFixed(1)} ms`]),
  ];
  return parts.join(", ");
}
