/** The shaped link: its trace, its load, and the frames' delays. */

import { effect, type Signal, useSignal } from "@preact/signals";
import { FolderOpen, Pause, Play, Square } from "lucide";
import { useEffect, useRef } from "preact/hooks";
import type { DirectionStatus, ShaperStatus } from "#client/wire/shaper";
import { frames } from "#lab/network/series";
import { Shaper } from "#lab/network/shaper";
import { append, noColumns } from "#viewer/charts/columns";
import type { ViewerSession } from "#viewer/session/session";
import { LiveChart } from "../chart/live-chart";
import type { Quantity } from "../chart/live-plot";
import { clock } from "../format";
import { Icon } from "../icon";
import { LinkForm } from "./link-form";
import { TraceList } from "./trace-list";

const RATES: readonly Quantity[] = [
  { label: "Target", unit: "Mbit/s", axis: "left", tone: "target", stepped: true },
  { label: "Delivered", unit: "Mbit/s", axis: "left", tone: "measured" },
];
const FRAMES: readonly Quantity[] = [
  { label: "Frame", unit: "kB", axis: "left", tone: "measured" },
  { label: "Round trip", unit: "ms", axis: "right", tone: "second" },
];

/** How many steps the arrow keys need from a trace's start to its end. */
const STEPS = 200;

export function NetworkPanel({ base, session }: { base: string; session: ViewerSession }) {
  const shaper = useSignal<Shaper | null>(null);
  const visible = session.presence.visible.value;
  useEffect(() => {
    if (!visible) return undefined;
    const current = new Shaper(base, location.href, () => performance.now());
    shaper.value = current;
    return () => current.dispose();
  }, [base, visible, shaper]);
  return shaper.value && <Link shaper={shaper.value} session={session} />;
}

function Link({ shaper, session }: { shaper: Shaper; session: ViewerSession }) {
  const frameColumns = useFrames(session);
  const status = shaper.status.value;
  const connectionError = shaper.connectionError.value;
  if (connectionError) return <Notice>{connectionError}</Notice>;
  if (!status) return <p class="muted small">Asking the shaper …</p>;
  return (
    <div class="network">
      {status.closed && <Notice>{status.closed}</Notice>}
      {shaper.actionError.value && <Notice>{shaper.actionError.value}</Notice>}
      <LiveChart name="Rate towards this page" quantities={RATES} columns={shaper.rates} />
      <Directions status={status} />
      <LiveChart name="Our frames" quantities={FRAMES} columns={frameColumns} />
      <Playing shaper={shaper} status={status} />
      <LinkForm link={status.link} onLink={(setting) => void shaper.act((api) => api.link(setting))} />
    </div>
  );
}

function Notice({ children }: { children: string }) {
  return (
    <p class="notice" role="alert">
      {children}
    </p>
  );
}

function Playing({ shaper, status }: { shaper: Shaper; status: ShaperStatus }) {
  const picked = useSignal<string | null>(null);
  const loopAtStart = useSignal(true);
  const traces = shaper.traces.value;
  const chosen = picked.value ?? status.trace ?? traces.find(({ error }) => !error)?.name ?? null;
  const loop = status.trace === null ? loopAtStart.value : status.loop;
  const paused = status.mode === "paused";
  const setLoop = () => {
    loopAtStart.value = !loop;
    if (status.trace !== null) void shaper.act((api) => api.loop(!loop));
  };
  return (
    <>
      <TraceList
        traces={traces}
        plots={shaper.plots.value}
        chosen={chosen}
        onChoose={(name) => {
          picked.value = name;
        }}
      />
      <OpenTrace
        shaper={shaper}
        onKept={(name) => {
          picked.value = name;
        }}
      />
      {status.trace !== null && <Position shaper={shaper} status={status} />}
      <div class="playing">
        <button
          type="button"
          class="quiet-button"
          disabled={chosen === null}
          onClick={() => chosen !== null && void shaper.act((api) => api.start({ trace: chosen, loop }))}
        >
          <Icon of={Play} size={14} /> Play
        </button>
        <button
          type="button"
          class="quiet-button"
          disabled={!paused && status.mode !== "playing"}
          onClick={() => void shaper.act((api) => (paused ? api.resume() : api.pause()))}
        >
          <Icon of={paused ? Play : Pause} size={14} /> {paused ? "Resume" : "Pause"}
        </button>
        <button
          type="button"
          class="quiet-button"
          title="Go back to the rate that the shaper has when nothing plays"
          onClick={() => void shaper.act((api) => api.stop())}
        >
          <Icon of={Square} size={14} /> Stop
        </button>
      </div>
      <label class="check">
        <input type="checkbox" checked={loop} onChange={setLoop} />
        Start again at the end
      </label>
      <p class="muted small" data-network="mode">
        {describe(status)}
      </p>
    </>
  );
}

/** A trace of a person's own. */
function OpenTrace({ shaper, onKept }: { shaper: Shaper; onKept: (name: string) => void }) {
  const input = useRef<HTMLInputElement>(null);
  const busy = useSignal(false);
  const upload = async (file: File) => {
    busy.value = true;
    const name = await shaper.upload(file);
    busy.value = false;
    if (name !== null) onKept(name);
  };
  return (
    <>
      <button
        type="button"
        class="quiet-button with-icon"
        title="A CSV of this project, or a log or trace that tigas trace import reads; the shaper keeps it until it stops"
        disabled={busy.value}
        onClick={() => input.current?.click()}
      >
        <Icon of={FolderOpen} size={14} /> {busy.value ? "Uploading…" : "Upload a trace…"}
      </button>
      <input
        ref={input}
        type="file"
        hidden
        aria-label="Trace file"
        onChange={({ currentTarget }) => {
          const [file] = currentTarget.files ?? [];
          if (file) void upload(file);
          currentTarget.value = ""; // the same file may be chosen again
        }}
      />
    </>
  );
}

/** Where in its trace the link is, and the way to go elsewhere. */
function Position({ shaper, status }: { shaper: Shaper; status: ShaperStatus }) {
  /** While a person drags it. */
  const wanted = useSignal<number | null>(null);
  const { position_ms, duration_ms } = status;
  const at = wanted.value ?? position_ms ?? 0;
  const go = async (position: number) => {
    await shaper.act((api) => api.seek(position));
    wanted.value = null;
  };
  return (
    <div class="movement-progress">
      <input
        type="range"
        aria-label="Place in the trace"
        aria-valuetext={`${clock(at)} of ${clock(duration_ms ?? 0)}`}
        min={0}
        max={duration_ms ?? 0}
        step={(duration_ms ?? 0) / STEPS}
        value={at}
        disabled={status.mode === "ended"}
        onInput={({ currentTarget }) => {
          wanted.value = currentTarget.valueAsNumber;
        }}
        onChange={({ currentTarget }) => void go(currentTarget.valueAsNumber)}
      />
      <output>
        {clock(at)} / {clock(duration_ms ?? 0)}
      </output>
    </div>
  );
}

function Directions({ status }: { status: ShaperStatus }) {
  return (
    <table class="directions">
      <thead>
        <tr>
          <th scope="col">Mbit/s</th>
          <th scope="col">Target</th>
          <th scope="col">Delivered</th>
          <th scope="col">Queue</th>
          <th scope="col">Drops</th>
        </tr>
      </thead>
      <tbody>
        <Direction name="Down" of={status.down} />
        <Direction name="Up" of={status.up} />
      </tbody>
    </table>
  );
}

function Direction({ name, of }: { name: string; of: DirectionStatus }) {
  return (
    <tr>
      <th scope="row">{name}</th>
      <td>{(of.target_kbps / 1000).toFixed(1)}</td>
      <td>{(of.delivered_kbps / 1000).toFixed(1)}</td>
      <td>{Math.round(of.queue_ms)} ms</td>
      <td>{of.drops}</td>
    </tr>
  );
}

/** The last minute of our frames, as the HUD knows them. */
function useFrames(session: ViewerSession): Signal<ReturnType<typeof noColumns>> {
  const columns = useSignal(noColumns(2));
  useEffect(() => {
    let shown = session.source.peek()?.stats.peek().shown ?? 0;
    return effect(() => {
      const stats = session.source.value?.stats.value;
      if (stats?.kind !== "requests") return;
      columns.value = append(columns.peek(), performance.now() / 1000, frames(stats, shown));
      shown = stats.shown;
    });
  }, [session, columns]);
  return columns;
}

function describe({ mode, trace, position_ms, duration_ms, backend, link }: ShaperStatus): string {
  const place = `${trace ?? ""}, ${clock(position_ms ?? 0)} of ${clock(duration_ms ?? 0)}`;
  const state = {
    constant: "A constant link",
    playing: `Plays ${place}`,
    paused: `Paused: ${place}`,
    ended: `Ended: ${trace ?? ""}`,
  };
  const conditions = `${Math.round((link.delay_ms ?? 0) * 2)} ms round trip, ${link.loss_pct ?? 0} % loss`;
  return `${state[mode]}; ${conditions} by ${backend === "netem" ? "the kernel's netem" : "the shaper's relay"}.`;
}
