/** Makes a run in this page: network, first pose, warm-up, movement. */
import { sleep } from "#client/async/retry";
import type { RunJob, RunUpload } from "#client/wire/store";
import type { ViewerSession } from "#viewer/session/session";
import type { Settings } from "#viewer/state/settings";
import type { ScenePose } from "#viewer/view/camera";
import type { Shaper } from "../network/shaper";
import type { About } from "../samples/layout";
import { whyFewer } from "../samples/sampler";
import { RunFailed } from "./errors";
import { RunLink } from "./link";
import type { Runner, RunPlan } from "./runner";

export interface Performance {
  /** An unused visit to the run's scene, with default settings. */
  readonly session: ViewerSession;
  readonly runner: Runner;
  readonly shaper: Shaper | null;
  /** The experiment that the samples belong to, in case the page is closed. */
  readonly experiment: string;
  readonly stage: (what: string) => void;
  readonly signal: AbortSignal;
}

export interface Performed {
  readonly upload: RunUpload;
  /** PNGs of the captured pictures, in order. */
  readonly captures: readonly Blob[];
  /** The folder of samples in this browser; null without. */
  readonly samples: string | null;
}

/** How long the viewer may take to show the first pose, in milliseconds. */
const READY_WITHIN = 60_000;
const LOOK_EVERY = 50;
const HIDDEN = "The page was hidden during the run.";

/**
 * Rejects with a RunFailed or an ApiError, or with the reason of `signal`. Afterwards the link has the shaper's
 * default rate again.
 */
export async function perform(job: RunJob, performance_: Performance): Promise<Performed> {
  const { session, runner, shaper, experiment, stage, signal } = performance_;
  const { configuration, settings, plan } = job;
  const warmUp = configuration.warm_up_s ?? 0;
  const link = new RunLink(shaper, configuration.network, warmUp);
  const onLeave = () => link.abandon();
  addEventListener("pagehide", onLeave);
  try {
    runner.stand(plan.points[0] as unknown as ScenePose);
    stage("Connecting");
    await waitUntil(
      () => session.phase.peek().kind === "playing",
      () => whyNoFrame(session),
      signal,
    );
    stage("Waiting for the first view");
    await link.begin();
    const { seed, ...chosen } = settings as { readonly seed: number } & Partial<Settings>;
    runner.seed(seed);
    runner.settings(chosen);
    runner.reconnect();
    await waitUntil(
      () => runner.state().ready,
      () => whyNoFrame(session),
      signal,
    );
    failIfUnlike(runner);
    stage("Warming up");
    await link.warmUp();
    await sleep(warmUp * 1000, signal);
    stage("Playing the movement");
    await waitUntil(visible, () => HIDDEN, signal);
    await link.play();
    const disturbed = new AbortController();
    const stop = link.watch(now, (sentence) => disturbed.abort(new RunFailed(sentence)));
    try {
      const about: About = { experiment, run: job.run, stored: false, title: job.title, started_unix_ms: Date.now() };
      const recording = await runner.run(
        { ...(plan as unknown as RunPlan), about },
        AbortSignal.any([signal, disturbed.signal]),
      );
      failIfUnlike(runner);
      failIfLost(session);
      if (!link.reports(now())) throw new RunFailed("The shaper stopped responding during the run.");
      const startedAt = recording.started_unix_ms - performance.timeOrigin;
      const { sampled } = runner;
      return {
        upload: {
          recording,
          link: link.samples(startedAt, startedAt + recording.ended_ms),
          backend: link.backend,
          sampling_problem: sampled && whyFewer(sampled),
        },
        captures: await Promise.all(recording.captures.map((_, index) => runner.takePicture(index))),
        samples: sampled?.key ?? null,
      };
    } catch (error) {
      await runner.discardSamples().catch(() => undefined); // they can also be deleted in the list
      throw error;
    } finally {
      stop();
    }
  } finally {
    removeEventListener("pagehide", onLeave);
    // The measurement is still valid; the next run reports a link that was not released.
    await link.release().catch(() => undefined);
  }
}

function now(): number {
  return performance.now();
}

/** Frames must be enhanced, reprojected or drawn as configured. */
function failIfUnlike(runner: Runner): void {
  const { problem } = runner.state();
  if (problem !== null) throw new RunFailed(`Frames cannot be shown as configured. ${problem}`);
}

/** Fails after a lost connection: if it returned, it only cost the run some views; if not, it may have ended for another reason. */
function failIfLost({ phase, source }: ViewerSession): void {
  if (phase.peek().kind !== "playing")
    throw new RunFailed("The connection was lost during the run and did not return.");
  if (source.peek()?.phase.peek().kind === "lost")
    throw new RunFailed("The stream was lost during the run and did not return.");
}

function visible(): boolean {
  return document.visibilityState === "visible";
}

/** Why no frame arrives, as far as the viewer knows. */
function whyNoFrame(session: ViewerSession): string {
  if (!visible()) return HIDDEN;
  const { phase, source } = session;
  const shown = source.peek()?.phase.peek();
  const said = [phase.peek(), shown].flatMap((one) => (one && "message" in one ? (one.message ?? []) : []));
  const problem = shown?.kind === "playing" ? shown.problem : undefined;
  return said[0] ?? problem ?? `No frame arrived within ${READY_WITHIN / 1000} s.`;
}

async function waitUntil(done: () => boolean, otherwise: () => string, signal: AbortSignal): Promise<void> {
  const limit = now() + READY_WITHIN;
  while (!done()) {
    if (now() > limit) throw new RunFailed(otherwise());
    await sleep(LOOK_EVERY, signal);
  }
}
