/** Side by side: what each side made of the last walk, and that in one sentence. It stays until the next walk has ended. */
import type { ComponentChildren } from "preact";
import type { Unmeasured, Walk, WalkedSide } from "../../charts/walk";
import { PLACES } from "../../state/sides";
import type { SeenQuality } from "../../viewer/comparison";
import { bitrate, bytes } from "../format";

/** Smaller differences are those of one picture on the display (ms). */
const ALIKE = 17;
/** Smaller differences of quality are hardly seen (dB). */
const ALIKE_DB = 0.5;

/** Who has answered a smaller share of what the other has hardly showed the walk: latencies say nothing of what never came. */
const HARDLY = 0.5;

interface Props {
  /** What the sides are called, from left to right. */
  readonly names: readonly string[];
  readonly walk: Walk | null;
  readonly quality: SeenQuality;
  /** Of these sides, the browser draws the pictures itself. */
  readonly local: readonly boolean[];
}

export function LastWalk({ names, walk, quality, local }: Props) {
  return (
    <section class="last-walk" aria-label="The last walk">
      <h4>The last walk</h4>
      {walk === null ? (
        <p class="muted small">Walk for a few seconds and stand still: what each side made of it is summed up here.</p>
      ) : (
        <>
          <p role="status">{verdict(walk, names, quality)}</p>
          <Table walk={walk} names={names} quality={quality} />
        </>
      )}
      <p class="muted small">{renderers(names, local)}</p>
    </section>
  );
}

function Table({ walk: { duration, sides }, names, quality }: Omit<Props, "walk" | "local"> & { readonly walk: Walk }) {
  const row = (label: string, cell: (of: WalkedSide) => string) => (
    <Row label={label}>
      {sides.map((of, i) => (
        <td key={PLACES[i]} data-side={PLACES[i]}>
          {isMeasured(of) ? cell(of) : "–"}
        </td>
      ))}
    </Row>
  );
  const { psnr, moments, problem } = quality;
  return (
    <table>
      <thead>
        <tr>
          <th scope="col">{(duration / 1000).toFixed(0)} s</th>
          {names.map((name, i) => (
            <th key={PLACES[i]} scope="col">
              <i class="swatch" data-tone={PLACES[i]} />
              {name}
            </th>
          ))}
        </tr>
      </thead>
      <tbody>
        {row("Latency, p50 · p95", ({ latency: { p50, p95 } }) => `${Math.round(p50)} · ${Math.round(p95)} ms`)}
        {row("New views/s", ({ newViewsPerSecond }) => rate(newViewsPerSecond))}
        {row("Stalled", ({ stalled }) => `${(stalled / 1000).toFixed(1)} s`)}
        {row("Bit rate", ({ bandwidth }) => bitrate(bandwidth))}
        {row("Received", (of) => bytes(of.bytes))}
        <Row
          label="PSNR as seen"
          title={problem ?? `What was on the screen against the view that was due, at ${moments} moments of the walk`}
        >
          {sides.map((_, i) => (
            <td key={PLACES[i]} data-side={PLACES[i]} data-stat="psnr">
              {psnr[i] === undefined ? (problem === null ? "…" : "–") : `${psnr[i].toFixed(1)} dB`}
            </td>
          ))}
        </Row>
      </tbody>
    </table>
  );
}

function Row({ label, title, children }: { label: string; title?: string; children: ComponentChildren }) {
  return (
    <tr title={title}>
      <th scope="row">{label}</th>
      {children}
    </tr>
  );
}

function rate(perSecond: number): string {
  return perSecond < 9.95 ? perSecond.toFixed(1) : String(Math.round(perSecond));
}

function isMeasured(side: WalkedSide | Unmeasured): side is WalkedSide {
  return typeof side !== "string";
}

/** Who followed the camera sooner, who was nearer to the truth, and what that took. */
export function verdict({ sides }: Walk, names: readonly string[], { psnr }: Pick<SeenQuality, "psnr">): string {
  const restarted = names.filter((_, i) => sides[i] === "restarted");
  if (restarted.length > 0) return `${restarted.join(" and ")} restarted during this walk; walk again to compare.`;
  const shown = sides
    .flatMap((of, i) => (isMeasured(of) ? [{ name: names[i] ?? "", of, psnr: psnr[i] }] : []))
    .toSorted((a, b) => a.of.latency.p50 - b.of.latency.p50);
  const [sooner, later] = shown;
  if (sooner === undefined) return "Neither side showed anything of this walk.";
  if (later === undefined) return `Only ${sooner.name} showed anything of this walk.`;
  const broken = sooner.of.inputs < HARDLY * later.of.inputs || later.of.inputs < HARDLY * sooner.of.inputs;
  const [first, second] = broken && sooner.of.inputs < later.of.inputs ? [later, sooner] : [sooner, later];
  const behind = Math.round(second.of.latency.p50 - first.of.latency.p50);
  const who = broken
    ? `${first.name} followed you, and ${second.name} hardly did`
    : behind < ALIKE
      ? `${first.name} and ${second.name} followed you equally soon`
      : `${first.name} followed you ${behind} ms sooner than ${second.name}`;
  const [views, others] = [first, second].map(({ of }) => rate(of.newViewsPerSecond));
  const seen = nearer(first, second);
  return `${who}: ${views} against ${others} new views a second${seen}, for ${bitrate(first.of.bandwidth)} against ${bitrate(second.of.bandwidth)}.`;
}

interface Judged {
  readonly name: string;
  readonly psnr: number | undefined;
}

/** Which of them was nearer to ground truth; empty while that is not known. */
function nearer(first: Judged, second: Judged): string {
  if (first.psnr === undefined || second.psnr === undefined) return "";
  const ahead = first.psnr - second.psnr;
  if (Math.abs(ahead) < ALIKE_DB) return ", as near to the truth";
  const { name } = ahead > 0 ? first : second;
  return `, with ${name} ${Math.abs(ahead).toFixed(1)} dB nearer to the truth`;
}

/** Who draws: what slows one side may slow the other. */
function renderers(names: readonly string[], local: readonly boolean[]): string {
  const own = names.filter((_, i) => local[i]);
  if (own.length === names.length) return "This browser draws both sides: each slows the other.";
  if (own.length > 0) return `This browser draws ${own.join()}; the server draws the other side.`;
  return "One renderer draws both sides. Where it is what limits them, look at one side alone.";
}
