/** Makes one run in this very page: settings, network, first pose, warm-up, movement. */
import { effect } from "@preact/signals";
import { sleep } from "../async/sleep";
import { poseAt, type TimedPose } from "../movement/playback";
import type { Shaper } from "../network/shaper";
import type { About } from "../samples/layout";
import { titleOf } from "../sources/sides";
import { settings } from "../state/app";
import { recorded } from "../state/settings";
import type { ViewerSession } from "../viewer/session";
import type { ShaperStatus } from "../wire/shaper";
import type { RunUpload } from "../wire/store";
import { RunFailed } from "./errors";
import { linkFor, linkProblem, linkSamples, watchLink } from "./link";
import { isLocal, type PlannedRun, settingsFor } from "./plan";
import type { Runner } from "./runner";

export interface MeasurementContext {
  readonly session: ViewerSession;
  readonly runner: Runner;
  readonly shaper: Shaper | null;
  /** The movement, in the scene's own frame. */
  readonly points: readonly TimedPose[];
  /** Of which experiment samples are, in case the page is closed. */
  readonly experiment: () => Pick<About, "name" | "plan" | "experiment">;
}

/** How long the viewer may take to show the first pose, in milliseconds. */
const READY_WITHIN = 60_000;
const LOOK_EVERY = 50;
/** A shaper reports its link five times per second; without a report for this many milliseconds it counts as lost. */
const SILENCE = 2000;
const HIDDEN = "The page was hidden, so that not all of the run could be shown.";

/**
 * `stage` is called with the present step. Rejects with a RunFailed or a ShaperError, or with the reason of `signal`.
 * Afterwards the link is the shaper's own again, and the camera is at the movement's first pose.
 */
export async function measure(
  { session, runner, shaper, points, experiment }: MeasurementContext,
  run: PlannedRun,
  stage: (what: string) => void,
  signal: AbortSignal,
): Promise<RunUpload> {
  if (points.length === 0) throw new RunFailed("The movement has no point.");
  const part = from(points, run.movement_offset_s * 1000);
  const first = poseAt(part, 0);
  const link = linkFor(shaper, run);
  runner.stand(first);
  try {
    stage("Connects");
    await reconnect(session, runner, signal);
    stage("Waits for the first view");
    await link.hold();
    runner.settings(settingsFor(run));
    runner.seed(run.seed);
    const download = isLocal(run.mode);
    const asked = [settings.peek(), ...(download ? [{ ...settings.peek(), mode: "local" } as const] : [])].map(
      recorded,
    );
    await waitUntil(
      () => runner.state().ready,
      READY_WITHIN,
      () => whyNoFrame(session),
      signal,
    );
    const { problem } = runner.state();
    if (problem !== null) throw new RunFailed(`Frames cannot be shown as configured. ${problem}`);
    stage("Warms up");
    await sleep(run.warm_up_s * 1000, signal);
    stage("Plays the movement");
    await waitUntil(visible, READY_WITHIN, () => HIDDEN, signal);
    const played = await link.play();
    const trouble = watchForTrouble(session, shaper, run, asked, played);
    const watch = watchLink(shaper, () => performance.now());
    try {
      const configuration = { ...run, ...session.rig.viewport.peek() };
      const about = { ...experiment(), run: null, configuration, started_unix_ms: Date.now() };
      const plan = {
        points: part,
        duration_ms: run.duration_s * 1000,
        capture_every_ms: run.capture_every_ms,
        sample_stride: run.sample_stride,
        download,
      };
      const recording = await runner.run({ ...plan, about }, AbortSignal.any([signal, trouble.signal]));
      if (!recording.complete) {
        throw new RunFailed(recording.hidden ? HIDDEN : "The movement was not played to its end without a pause.");
      }
      // A scene that did not arrive in time is a result.
      if (recording.frames.length === 0 && !download) throw new RunFailed("No frame came during the run.");
      if (played !== null && performance.now() - (watch.history.at(-1)?.at ?? 0) > SILENCE) {
        throw new RunFailed("The shaper fell silent during the run.");
      }
      const startedAt = recording.started_unix_ms - performance.timeOrigin;
      return {
        configuration,
        recording,
        link: linkSamples(watch.history, startedAt, startedAt + recording.ended_ms),
        scene_bytes: session.scene.peek()?.file_bytes ?? null,
        scene_sha256: session.scene.peek()?.file_sha256 ?? null,
        backend: shaper?.status.peek()?.backend ?? null,
      };
    } catch (error) {
      await runner.discardSamples().catch(() => undefined); // they can also be deleted in the list
      throw error;
    } finally {
      watch.stop();
      trouble.stop();
    }
  } finally {
    runner.stand(first); // until the next run: a person's keys must not move the camera meanwhile
    // The measurement counts all the same; the next run reports a link that does not change back.
    await link.release().catch(() => undefined);
  }
}

/** A new connection, no stream, and a controller that has learnt nothing: a run knows nothing of those before it. */
async function reconnect(session: ViewerSession, runner: Runner, signal: AbortSignal): Promise<void> {
  runner.settings({ mode: "stateless", controller: "fixed" });
  session.retry();
  await waitUntil(
    () => session.phase.peek().kind === "playing",
    READY_WITHIN,
    () => whyNoFrame(session),
    signal,
  );
}

/**
 * Aborts with a RunFailed when something spoils a run, which was to have one after the other of the settings `asked`, and began with
 * the link `played`.
 */
function watchForTrouble(
  session: ViewerSession,
  shaper: Shaper | null,
  run: PlannedRun,
  asked: readonly string[],
  played: ShaperStatus | null,
) {
  const controller = new AbortController();
  let known = played;
  const lens = () => JSON.stringify([session.rig.viewport.value, session.rig.intrinsics.value]);
  const before = lens();
  const trouble = (): string | null => {
    const { value: source } = session.source;
    const shown = source?.phase.value;
    const { value: phase } = session.phase;
    if (phase.kind === "failed") return phase.message;
    if (phase.kind !== "playing") return "The connection was lost during the run.";
    const enhanced = source?.enhancement?.status.value;
    if (enhanced?.kind === "failed") return `Enhancement was given up during the run. ${enhanced.message}`;
    const turned = session.unturned.value;
    if (turned !== null) return `Reprojection ended during the run. ${turned}`;
    if (shown?.kind === "failed") return shown.message;
    if (!isLocal(run.mode) && shown?.kind !== "playing")
      return `The ${titleOf(settings.value.mode)} stream was lost during the run.`;
    if (!asked.includes(recorded(settings.value)) || lens() !== before)
      return "Settings or the window's size were changed during the run.";
    const status = shaper?.status.value ?? null;
    if (known === null) return null; // without a shaper
    if (status === null) return shaper?.connectionError.value ?? null;
    if (status.time_ms <= known.time_ms) return null; // reported before the link was as requested
    const said = linkProblem(run.network, known, status);
    known = status;
    return said;
  };
  const stop = effect(() => {
    const said = trouble();
    if (said !== null) controller.abort(new RunFailed(said));
  });
  return { signal: controller.signal, stop };
}

/** A movement from a time on, in milliseconds. */
function from(points: readonly TimedPose[], begin: number): readonly TimedPose[] {
  return points.map((point) => ({ ...point, t_ms: point.t_ms - begin }));
}

function visible(): boolean {
  return document.visibilityState === "visible";
}

/** Why no frame comes, as far as the viewer knows. */
function whyNoFrame(session: ViewerSession): string {
  if (!visible()) return HIDDEN;
  const phases = [session.phase.peek(), session.source.peek()?.phase.peek()];
  const said = phases.flatMap((phase) =>
    phase && phase.kind !== "connecting" && "message" in phase ? phase.message : [],
  );
  return said[0] ?? `No frame came within ${READY_WITHIN / 1000} s.`;
}

async function waitUntil(
  done: () => boolean,
  within: number,
  otherwise: () => string,
  signal: AbortSignal,
): Promise<void> {
  const limit = performance.now() + within;
  while (!done()) {
    if (performance.now() > limit) throw new RunFailed(otherwise());
    await sleep(LOOK_EVERY, signal);
  }
}
