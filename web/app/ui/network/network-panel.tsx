/** The shaped link: its trace, its load, and the frames' delays. */

import { effect, type Signal, useSignal } from "@preact/signals";
import { Pause, Play, Square } from "lucide";
import { useEffect, useState } from "preact/hooks";
import type { DirectionStatus, ShaperStatus, TracePoints, TraceSummary } from "#client/wire/shaper";
import { frames, type Shaper, stepPath } from "#lab/network/shaper";
import { append, noColumns } from "#viewer/charts/history";
import type { ViewerSession } from "#viewer/session/session";
import { FileButton, QuietButton } from "../button";
import { LiveChart } from "../chart/chart";
import type { Quantity } from "../chart/plots";
import { Check, RadioList, Seek } from "../fields";
import { bitrate, clock } from "../format";
import { Notice } from "../notice";
import { LinkForm } from "./link-form";
import { useShaper } from "./use-shaper";

const RATES: readonly Quantity[] = [
  { label: "Target", unit: "Mbit/s", axis: "left", tone: "target", stepped: true },
  { label: "Delivered", unit: "Mbit/s", axis: "left", tone: "measured" },
];
const FRAMES: readonly Quantity[] = [
  { label: "Frame", unit: "kB", axis: "left", tone: "measured" },
  { label: "Round trip", unit: "ms", axis: "right", tone: "second" },
];

/** Size of a trace's outline, in pixels. */
const OUTLINE: [number, number] = [72, 24];

export function NetworkPanel({ base, session }: { base: string; session: ViewerSession }) {
  const shaper = useShaper(base, session.presence.visible.value, true);
  return shaper && <Link shaper={shaper} session={session} />;
}

function Link({ shaper, session }: { shaper: Shaper; session: ViewerSession }) {
  const frameColumns = useFrames(session);
  const status = shaper.status.value;
  const connectionError = shaper.connectionError.value;
  if (connectionError) return <Notice>{connectionError}</Notice>;
  if (!status) return <p class="muted small">Connecting to the shaper…</p>;
  return (
    <div class="network stack">
      <Notice>{status.closed}</Notice>
      <Notice>{shaper.actionError.value}</Notice>
      <LiveChart name="Rate to this page" quantities={RATES} columns={shaper.rates} />
      <Directions status={status} />
      <LiveChart name="Frames of this page" quantities={FRAMES} columns={frameColumns} />
      <Playing shaper={shaper} status={status} />
      <LinkForm link={status.link} onLink={(setting) => void shaper.act((api) => api.link(setting))} />
    </div>
  );
}

function Playing({ shaper, status }: { shaper: Shaper; status: ShaperStatus }) {
  const [picked, setPicked] = useState<string | null>(null);
  const [loopAtStart, setLoopAtStart] = useState(true);
  const [uploading, setUploading] = useState(false);
  const traces = shaper.traces.value;
  const chosen = picked ?? status.trace ?? traces.find(({ error }) => !error)?.name ?? null;
  const loop = status.trace === null ? loopAtStart : status.loop;
  const paused = status.mode === "paused";
  const setLoop = () => {
    setLoopAtStart(!loop);
    if (status.trace !== null) void shaper.act((api) => api.loop(!loop));
  };
  const upload = async (file: File) => {
    setUploading(true);
    const name = await shaper.upload(file);
    setUploading(false);
    if (name !== null) setPicked(name);
  };
  return (
    <>
      <RadioList
        name="trace"
        label="Trace"
        boxed
        rows={traces.map((trace) => traceRow(trace, shaper.plots.value.get(trace.name)))}
        chosen={chosen}
        onChoose={setPicked}
      />
      <FileButton
        label="Trace file"
        title="A CSV in the TIGAS format, or a log or trace that tigas trace import reads; kept until the shaper stops"
        disabled={uploading}
        onFile={(file) => void upload(file)}
      >
        {uploading ? "Uploading…" : "Upload a trace…"}
      </FileButton>
      {status.trace !== null && <Position shaper={shaper} status={status} />}
      <div class="playing">
        <QuietButton
          icon={Play}
          disabled={chosen === null}
          onClick={() => chosen !== null && void shaper.act((api) => api.start({ trace: chosen, loop }))}
        >
          Play
        </QuietButton>
        <QuietButton
          icon={paused ? Play : Pause}
          disabled={!paused && status.mode !== "playing"}
          onClick={() => void shaper.act((api) => (paused ? api.resume() : api.pause()))}
        >
          {paused ? "Resume" : "Pause"}
        </QuietButton>
        <QuietButton
          icon={Square}
          title="Stop the trace and return to the default rate"
          onClick={() => void shaper.act((api) => api.stop())}
        >
          Stop
        </QuietButton>
      </div>
      <Check checked={loop} onChange={setLoop}>
        Loop
      </Check>
      <p class="muted small" data-network="mode">
        {describe(status)}
      </p>
    </>
  );
}

/** A trace's row in the list, with a small plot of its rate towards the client. */
function traceRow({ name, error, mean_down_kbps = 0, duration_ms = 0 }: TraceSummary, points?: TracePoints) {
  const [width, height] = OUTLINE;
  return {
    key: name,
    title: (
      <>
        {name}
        <span class="muted small">{error ?? `${bitrate(mean_down_kbps * 1000)} · ${clock(duration_ms)}`}</span>
      </>
    ),
    detail: (
      <svg class="trace-plot" aria-hidden="true" viewBox={`0 -1 ${width} ${height + 2}`} width={width} height={height}>
        {points && (
          <path
            d={stepPath(points.times_ms, points.down_kbps, points.duration_ms, OUTLINE)}
            fill="none"
            stroke="var(--accent)"
            stroke-width="1.25"
          />
        )}
      </svg>
    ),
    tooltip: error ?? undefined,
    disabled: Boolean(error),
  };
}

/** The link's position in its trace, with a slider to change it. */
function Position({ shaper, status }: { shaper: Shaper; status: ShaperStatus }) {
  /** Set while the user drags the slider. */
  const [wanted, setWanted] = useState<number | null>(null);
  const go = async (position: number) => {
    await shaper.act((api) => api.seek(position));
    setWanted(null);
  };
  return (
    <Seek
      label="Position in the trace"
      at={wanted ?? status.position_ms ?? 0}
      duration={status.duration_ms ?? 0}
      disabled={status.mode === "ended"}
      onSeek={setWanted}
      onRelease={(position) => void go(position)}
    />
  );
}

function Directions({ status }: { status: ShaperStatus }) {
  return (
    <table class="directions">
      <thead class="muted">
        <tr>
          {["Mbit/s", "Target", "Delivered", "Queue", "Drops"].map((name) => (
            <th key={name} scope="col">
              {name}
            </th>
          ))}
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

/** The last minute of this page's frames, as the HUD shows them. */
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
    constant: "Constant link",
    playing: `Playing ${place}`,
    paused: `Paused: ${place}`,
    ended: `Ended: ${trace ?? ""}`,
  };
  const conditions = `${Math.round((link.delay_ms ?? 0) * 2)} ms round trip, ${link.loss_pct ?? 0} % loss`;
  return `${state[mode]}; ${conditions}, applied by ${backend === "netem" ? "the kernel's netem" : "the shaper's relay"}.`;
}
