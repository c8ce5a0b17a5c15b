/**
 * The samples of a run: received frame, shown frame and ground truth in a row, a slider between two, and differences.
 */
import { useSignal } from "@preact/signals";
import { useEffect, useMemo } from "preact/hooks";
import { ApiError } from "#client/http/problem";
import type { SampleRow } from "#client/wire/store";

const PICTURES = {
  original: "Received",
  enhanced: "Enhanced",
  truth: "Ground truth",
  replayed: "Rendered again",
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
  /** A picture by its name. */
  readonly load: (name: string) => Promise<Blob>;
}

export function SampleGallery({ samples, load }: Props) {
  const chosen = useSignal(0);
  const sample = samples[Math.min(chosen.value, samples.length - 1)];
  if (sample === undefined) return <p>It has no samples.</p>;
  const step = (by: number) => {
    chosen.value = Math.max(0, Math.min(samples.length - 1, chosen.value + by));
  };
  return (
    <section class="sample-gallery" aria-label="Samples">
      <div class="sample-choice">
        <button type="button" class="button quiet" disabled={chosen.value === 0} onClick={() => step(-1)}>
          Previous
        </button>
        <label>
          Sample{" "}
          <select
            value={sample.seq}
            onChange={({ currentTarget }) => {
              chosen.value = currentTarget.selectedIndex;
            }}
          >
            {samples.map(({ seq, at }) => (
              <option key={seq} value={seq}>
                {seq}, at {(at / 1000).toFixed(1)} s
              </option>
            ))}
          </select>
        </label>
        <button
          type="button"
          class="button quiet"
          disabled={chosen.value >= samples.length - 1}
          onClick={() => step(1)}
        >
          Next
        </button>
      </div>
      <Pictures key={sample.seq} sample={sample} load={load} />
    </section>
  );
}

function Pictures({ sample, load }: { sample: SampleRow; load: Props["load"] }) {
  const { urls, problem } = useUrls(sample, load);
  const left = useSignal<View>(sample.enhanced ? "enhanced" : "original");
  const right = useSignal<View>("truth");
  const at = useSignal(50);
  const views = useMemo(() => viewsOf(sample), [sample]);
  const ratio = useSignal(16 / 9);
  const measure = ({ currentTarget }: { currentTarget: HTMLImageElement }) => {
    ratio.value = currentTarget.naturalWidth / currentTarget.naturalHeight;
  };
  const choose = (label: string, view: typeof left) => (
    <label>
      {label}{" "}
      <select
        value={view.value}
        onChange={({ currentTarget }) => {
          view.value = currentTarget.value as View;
        }}
      >
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
      {problem && (
        <p class="notice" role="alert">
          {problem}
        </p>
      )}
      <p class="small muted">{about(sample)}</p>
      <Remarks sample={sample} />
      <div class="sample-choice">
        {choose("Left", left)}
        {choose("Right", right)}
      </div>
      <div class="wipe-box" style={{ "--at": `${at.value}%`, "--ratio": ratio.value }}>
        <div class="wipe">
          <Layer view={right.value} urls={urls} />
          <div class="wipe-left">
            <Layer view={left.value} urls={urls} />
          </div>
        </div>
        <input
          type="range"
          min="0"
          max="100"
          step="0.5"
          value={at.value}
          aria-label="How much of the left picture"
          onInput={({ currentTarget }) => {
            at.value = currentTarget.valueAsNumber;
          }}
        />
      </div>
      <div class="sample-row">
        {(["original", "enhanced", "truth"] as const).map(
          (name) =>
            urls[name] && (
              <figure key={name}>
                <img src={urls[name]} alt={PICTURES[name]} onLoad={measure} />
                <figcaption class="small muted">{PICTURES[name]}</figcaption>
              </figure>
            ),
        )}
      </div>
    </>
  );
}

/** A picture, or how far it is from ground truth: the browser's compositor subtracts, and multiplies. */
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
          The renderer answered differently when it was asked again: ground truth may not be this frame's.
        </p>
      )}
      {truth === null && problem === null && <p class="small">Its ground truth is not rendered yet.</p>}
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
        if (!(error instanceof ApiError)) throw error;
        problem.value = error.message;
      }
    };
    void take("original", original);
    void take("enhanced", enhanced);
    void take("truth", truth);
    void take("replayed", replayed);
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
