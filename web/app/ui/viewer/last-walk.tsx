/** Side by side: the figures of each side for the last walk, and a sentence that sums them up. They stay until the next walk ends. */

import type { ComponentChildren } from "preact";
import type { Unmeasured, Walk, WalkedSide } from "#viewer/charts/walk";
import type { SeenQuality } from "#viewer/session/comparison";
import type { ViewerSession } from "#viewer/session/session";
import { sideTitles } from "#viewer/sources/sides";
import { PLACES } from "#viewer/state/settings";
import { settings } from "../../state/app";
import { bitrate, bytes } from "../format";

/** Smaller differences are within one display frame (ms). */
const ALIKE = 17;
/** Smaller differences in quality are hardly visible (dB). */
const ALIKE_DB = 0.5;

/**
 * Below this share of the other side's answered inputs or new views, a side hardly showed the walk, and its age means
 * little.
 */
const HARDLY_ANSWERED = 0.5;
const HARDLY_NEW = 0.1;

interface Props {
  /** Labels of the sides, from left to right. */
  readonly names: readonly string[];
  readonly walk: Walk | null;
  readonly quality: SeenQuality;
  /** Whether the browser itself draws each side. */
  readonly local: readonly boolean[];
}

export function LastWalk({ names, walk, quality, local }: Props) {
  return (
    <section class="last-walk stack" aria-label="Last walk">
      <h4>Last walk</h4>
      {walk === null ? (
        <p class="muted small">Walk for a few seconds, then stand still to see a summary of each side.</p>
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

/** Shown over the stage while the lab is closed: the last walk in one sentence; a click opens all of its figures. */
export function WalkVerdict({ session, onOpen }: { session: ViewerSession; onOpen: () => void }) {
  const comparison = session.comparison.value;
  const walk = comparison?.walks.last.value;
  if (!comparison || !walk || comparison.sides.length < 2) return null;
  return (
    <button type="button" class="floating walk-verdict row small" title="See all measurements" onClick={onOpen}>
      <span role="status">{verdict(walk, sideTitles(settings.value), comparison.quality.value)}</span>
    </button>
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
        {row("Content age", ({ contentAge }) => `${Math.round(contentAge)} ms`)}
        {row("Latency, p50 · p95", ({ latency: { p50, p95 } }) => `${Math.round(p50)} · ${Math.round(p95)} ms`)}
        {row("New views/s", ({ newViewsPerSecond }) => rate(newViewsPerSecond))}
        {row("Stalled", ({ stalled }) => `${(stalled / 1000).toFixed(1)} s`)}
        {row("Bit rate", ({ bandwidth }) => bitrate(bandwidth))}
        {row("Received", (of) => bytes(of.bytes))}
        <Row
          label="PSNR as seen"
          title={
            problem ?? `The picture on the screen compared with the correct view, at ${moments} moments of the walk`
          }
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
      <th scope="row" class="muted">
        {label}
      </th>
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

/** Verdict: the fresher side, the side closer to the reference, and their cost. */
export function verdict({ sides }: Walk, names: readonly string[], { psnr }: Pick<SeenQuality, "psnr">): string {
  const restarted = names.filter((_, i) => sides[i] === "restarted");
  if (restarted.length > 0) return `${restarted.join(" and ")} restarted during this walk; walk again to compare.`;
  const shown = sides
    .flatMap((of, i) => (isMeasured(of) ? [{ i, name: names[i] ?? "", of, psnr: psnr[i] }] : []))
    .toSorted((a, b) => a.of.contentAge - b.of.contentAge);
  const fresh = shown.filter(({ of }) => of.newViewsPerSecond > 0);
  const [newer, older] = fresh;
  if (newer === undefined) return "Neither side showed anything new during this walk.";
  if (older === undefined) {
    const other = names[1 - newer.i];
    return `${other} showed nothing new during this walk; ${newer.name} showed ${rate(newer.of.newViewsPerSecond)} new views per second.`;
  }
  const broken = hardly(newer.of, older.of) || hardly(older.of, newer.of);
  const [first, second] = broken && hardly(newer.of, older.of) ? [older, newer] : [newer, older];
  const behind = Math.round(second.of.contentAge - first.of.contentAge);
  const who = broken
    ? `${first.name} kept up with you, and ${second.name} hardly did`
    : behind < ALIKE
      ? `${first.name} and ${second.name} were equally up to date`
      : `${first.name} was ${behind} ms more up to date than ${second.name}`;
  const [views, others] = [first, second].map(({ of }) => rate(of.newViewsPerSecond));
  const seen = closer(first, second);
  return `${who}: ${views} versus ${others} new views per second${seen}, for ${bitrate(first.of.bandwidth)} versus ${bitrate(second.of.bandwidth)}.`;
}

function hardly(side: WalkedSide, other: WalkedSide): boolean {
  return side.inputs < HARDLY_ANSWERED * other.inputs || side.newViewsPerSecond < HARDLY_NEW * other.newViewsPerSecond;
}

interface Judged {
  readonly name: string;
  readonly psnr: number | undefined;
}

/** Which side was closer to ground truth; empty until that is known. */
function closer(first: Judged, second: Judged): string {
  if (first.psnr === undefined || second.psnr === undefined) return "";
  const ahead = first.psnr - second.psnr;
  if (Math.abs(ahead) < ALIKE_DB) return ", equally close to the reference";
  const { name } = ahead > 0 ? first : second;
  return `, with ${name} ${Math.abs(ahead).toFixed(1)} dB closer to the reference`;
}

/** Names the device that renders the sides, as it may slow both down. */
function renderers(names: readonly string[], local: readonly boolean[]): string {
  const own = names.filter((_, i) => local[i]);
  if (own.length === names.length) return "This browser draws both sides, so each slows the other down.";
  if (own.length > 0) return `This browser draws ${own.join()}; the server draws the other side.`;
  return "The server draws both sides. If it is the bottleneck, view one side at a time.";
}
