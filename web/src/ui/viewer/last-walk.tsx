/** Side by side: what each side made of the last walk, and that in one sentence. It stays until the next walk has ended. */
import { SIDES } from "../../charts/history";
import type { Walk, WalkedSide } from "../../charts/walk";
import { bitrate } from "../format";
import { SIDE_NAMES } from "./names";

/** Smaller differences are those of one picture on the display (ms). */
const ALIKE = 17;

export function LastWalk({ walk }: { walk: Walk | null }) {
  return (
    <section class="last-walk" aria-label="The last walk">
      <h4>The last walk</h4>
      {walk === null ? (
        <p class="muted small">Walk for a few seconds and stand still: what each side made of it is summed up here.</p>
      ) : (
        <>
          <p role="status">{verdict(walk)}</p>
          <table>
            <thead>
              <tr>
                <th scope="col">{(walk.duration / 1000).toFixed(0)} s</th>
                <th scope="col">Latency, p50 · p95</th>
                <th scope="col">New views/s</th>
                <th scope="col">Data</th>
                <th scope="col">Stalled</th>
              </tr>
            </thead>
            <tbody>
              {SIDES.map((side) => (
                <tr key={side} data-side={side}>
                  <th scope="row">{SIDE_NAMES[side]}</th>
                  <Cells of={walk.sides[side]} />
                </tr>
              ))}
            </tbody>
          </table>
        </>
      )}
      <p class="muted small">One renderer draws both sides. Where it is what limits them, look at one side alone.</p>
    </section>
  );
}

function Cells({ of }: { of: WalkedSide | null }) {
  if (of === null) return <td colSpan={4}>nothing shown</td>;
  const { latency, newViewsPerSecond, bandwidth, stalled } = of;
  return (
    <>
      <td>{`${Math.round(latency.p50)} · ${Math.round(latency.p95)} ms`}</td>
      <td>{rate(newViewsPerSecond)}</td>
      <td>{bitrate(bandwidth)}</td>
      <td>{`${(stalled / 1000).toFixed(1)} s`}</td>
    </>
  );
}

function rate(perSecond: number): string {
  return perSecond < 9.95 ? perSecond.toFixed(1) : String(Math.round(perSecond));
}

/** Who followed the camera sooner, and what that took. */
export function verdict({ sides }: Walk): string {
  const shown = SIDES.flatMap((side) => {
    const of = sides[side];
    return of === null ? [] : [{ name: SIDE_NAMES[side], of }];
  }).toSorted((a, b) => a.of.latency.p50 - b.of.latency.p50);
  const [first, second] = shown;
  if (first === undefined) return "Neither side showed anything of this walk.";
  if (second === undefined) return `Only ${first.name} showed anything of this walk.`;
  const behind = Math.round(second.of.latency.p50 - first.of.latency.p50);
  const who =
    behind < ALIKE
      ? `${first.name} and ${second.name} followed you equally soon`
      : `${first.name} followed you ${behind} ms sooner than ${second.name}`;
  const [views, others] = [first, second].map(({ of }) => rate(of.newViewsPerSecond));
  return `${who}: ${views} against ${others} new views a second, for ${bitrate(first.of.bandwidth)} against ${bitrate(second.of.bandwidth)}.`;
}
