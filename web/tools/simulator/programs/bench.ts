/** Compares controllers in the simulator over many different trace segments (docs/adaptation.md): paired differences with intervals. */
import { readFileSync, writeFileSync } from "node:fs";
import { basename } from "node:path";
import { parseArgs } from "node:util";
import { seeded } from "#client/abr/random";
import { CONTROLLER_NAMES } from "#client/abr/registry";
import { INTERACTIVE_MS } from "#client/wire/figures";
import { readMovement } from "#viewer/movement/movement-file";
import { bootstrap } from "../bootstrap";
import { controllerFactory } from "../controllers";
import { segments } from "../cuts";
import { PaperEndpoints } from "../endpoints";
import { Head } from "../head";
import type { Run } from "../report";
import { simulate } from "../simulate";
import type { Figures } from "../tally";
import { parseTrace } from "../trace";
import { number, SHARED, shared } from "./options";

const USAGE = `npm run abr-bench -- [options] TRACE.csv...
  --controller NAME   as in abr-sim, or hindsight, which is each segment's best fixed rung by the PSNR of the
                      seen picture; may be repeated [all of these, and all fixed rungs]
  --of NAME           the controller that is compared with each of the others [seen]
  --segments N        number of different random parts of the traces, taken from all in turn [48]
  --seconds N         duration of each [30]
  --rtt MS            round trip in place of the traces' own delay; may be repeated [20, 50, 100]
  --jitter MS         each way, in addition to the round trip [0]
  --render MS, --render-best MS, --scale X, --batch MS   as in abr-sim
  --movement FILE     a movement that turns the camera, one part per segment; may be repeated [synthetic turns]
  --ladder FILE       a scene's ladder.json (docs/adaptation.md) [the paper's]
  --way WAY           how the page shows a frame that is older than the view: stale, rotation, depth, or predicted,
                      which also uses depth [predicted]
  --seed N            [1]
  --json FILE         figures of all runs
`;

const HINDSIGHT = "hindsight";

const COLUMNS: readonly (readonly [title: string, value: (figures: Figures) => number, digits: number])[] = [
  [`poses ≤ ${INTERACTIVE_MS} ms, %`, (f) => 100 * f.inTime, 1],
  ["photon mean, ms", (f) => f.photonMean, 1],
  ["photon p95, ms", (f) => f.photonP95, 0],
  ["view, dB", (f) => f.viewPsnr, 2],
  ["view MSE", (f) => f.viewError, 0],
  ["SSIM", (f) => f.viewSsim, 4],
  ["content age, ms", (f) => f.contentAge, 0],
  ["mean rung", (f) => f.rungOverTime, 2],
  ["halvings", (f) => f.halvings, 2],
  ["frames/s", (f) => f.framesPerSecond, 1],
  ["switches/min", (f) => f.switches, 1],
  ["Mbit/s", (f) => f.bandwidth, 1],
  ["lines at 0.5 s", (f) => f.linesAt500, 0],
  ["lines at 1 s", (f) => f.linesAt1000, 0],
  ["lines at 2 s", (f) => f.linesAt2000, 0],
  ["lines at 5 s", (f) => f.linesAt5000, 0],
];

async function main(): Promise<void> {
  const { values, positionals } = parseArgs({
    allowPositionals: true,
    options: {
      ...SHARED,
      of: { type: "string", default: "seen" },
      segments: { type: "string", default: "48" },
      seconds: { type: "string", default: "30" },
      rtt: { type: "string", multiple: true, default: ["20", "50", "100"] },
      jitter: { type: "string", default: "0" },
      movement: { type: "string", multiple: true, default: [] },
    },
  });
  if (values.help || positionals.length === 0) return void process.stdout.write(USAGE);
  const { way, ladder, server, seed } = shared(values);
  const jitter_ms = number("--jitter", values.jitter);
  const duration = number("--seconds", values.seconds) * 1000;
  const fixed = ladder.map((_, rung) => `fixed:${rung}`);
  const names = values.controller ?? [...CONTROLLER_NAMES, ...fixed, HINDSIGHT];
  if (names.includes(HINDSIGHT)) names.push(...fixed.filter((name) => !names.includes(name)));
  if (!names.includes(values.of)) throw new Error(`--of is one of ${names.join(", ")}, not "${values.of}".`);
  const movements = values.movement.map((path) => readMovement(readFileSync(path, "utf8"), basename(path)));
  const traces = positionals.map((path) => ({
    name: basename(path, ".csv"),
    trace: parseTrace(readFileSync(path, "utf8")),
  }));
  const blocks = segments(traces, number("--segments", values.segments), duration, seeded(seed));
  const runs: (Run & { readonly block: number; readonly start: number })[] = [];
  for (const [block, { name, start, trace: part }] of blocks.entries()) {
    const movement = movements[block % movements.length];
    const from = seeded(seed + block)() * Math.max(0, (movement?.duration ?? 0) - duration);
    const head = movement && new Head(movement.points, from);
    for (const roundTrip of values.rtt.map((text) => number("--rtt", text))) {
      const trace = { ...part, steps: part.steps.map((step) => ({ ...step, delay_ms: roundTrip / 2, jitter_ms })) };
      for (const controller of names.filter((other) => other !== HINDSIGHT)) {
        const figures = await simulate({
          controller: controllerFactory(controller),
          trace,
          ladder,
          duration,
          roundTrip: null,
          endpoints: new PaperEndpoints(ladder, seed + block, server),
          way,
          ...(head && { head }),
          seed: seed + block,
        });
        runs.push({ block, trace: name, start, roundTrip, controller, figures });
      }
      if (!names.includes(HINDSIGHT)) continue;
      const rungs = runs.filter(
        (run) => run.block === block && run.roundTrip === roundTrip && fixed.includes(run.controller),
      );
      const best = rungs.reduce((a, b) => (b.figures.viewPsnr > a.figures.viewPsnr ? b : a));
      runs.push({ ...best, controller: HINDSIGHT });
    }
  }
  const different = new Set(blocks.map(({ name }) => name)).size;
  process.stdout.write(`${blocks.length} segments of ${values.seconds} s from ${different} traces\n`);
  for (const roundTrip of values.rtt.map((text) => number("--rtt", text))) {
    const of = (controller: string) =>
      runs.filter((run) => run.roundTrip === roundTrip && run.controller === controller).map(({ figures }) => figures);
    process.stdout.write(`\n| RTT ${roundTrip} ms | ${COLUMNS.map(([title]) => title).join(" | ")} |\n`);
    process.stdout.write(`|---|${COLUMNS.map(() => "---:|").join("")}\n`);
    for (const controller of names) {
      const cells = COLUMNS.map(([, value, digits]) => {
        const all = of(controller).map(value);
        return (all.reduce((sum, each) => sum + each, 0) / all.length).toFixed(digits);
      });
      process.stdout.write(`| ${controller} | ${cells.join(" | ")} |\n`);
    }
    for (const controller of names.filter((name) => name !== values.of)) {
      const cells = COLUMNS.map(([, value, digits]) => {
        const [ours, theirs] = [of(values.of), of(controller)];
        const { mean, low, high } = bootstrap(
          ours.map((figures, i) => value(figures) - value(theirs[i] as Figures)),
          seeded(seed),
        );
        return `${mean.toFixed(digits)} (${low.toFixed(digits)} to ${high.toFixed(digits)})`;
      });
      process.stdout.write(`| ${values.of} − ${controller} | ${cells.join(" | ")} |\n`);
    }
  }
  if (values.json !== undefined) writeFileSync(values.json, `${JSON.stringify({ options: values, runs }, null, 1)}\n`);
}

await main();
