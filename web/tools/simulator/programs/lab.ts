/** Compares the simulator with runs of the lab (docs/adaptation.md), and prints how far the two agree. */
import { existsSync, readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { read as csv } from "vega";
import { controllerFactory } from "../controllers";
import { agreement, conditionOf, conditions, type LabRun, MeasuredEndpoints, offered, PAIRS } from "../lab";
import { simulate } from "../simulate";

const USAGE = `npm run abr-lab -- EXPERIMENT
  the folder of an experiment in the mode stateless, without reprojection or prediction, with its report
`;

async function main(): Promise<void> {
  const [folder] = process.argv.slice(2);
  if (folder === undefined || folder.startsWith("-")) return void process.stdout.write(USAGE);
  const figures = reported(folder);
  const runs = readdirSync(join(folder, "runs")).flatMap((name) => {
    const known = figures.get(name);
    return known === undefined ? [] : [{ ...read(join(folder, "runs", name)), figures: known }];
  });
  if (runs.length === 0) throw new Error(`${folder} has no complete runs in its runs.csv: make its report first.`);
  const simulated = [];
  for (const [i, run] of runs.entries()) {
    const alike = runs.filter((other) => conditionOf(other) === conditionOf(run)).flatMap((other) => other.frames);
    simulated.push({
      ...run,
      simulated: await simulate({
        controller: offered(controllerFactory(run.controller), run),
        ...conditions(run),
        ladder: run.ladder,
        duration: run.duration,
        roundTrip: null,
        endpoints: new MeasuredEndpoints(run, alike, i),
        way: "stale",
        seed: run.seed,
      }),
    });
  }
  const cell = (value: number) => value.toFixed(Math.abs(value) < 10 ? 2 : 0);
  const rows = agreement(simulated).map(({ title, lab, simulated, error, runs, controllers }) =>
    [title, cell(lab), cell(simulated), cell(error), runs.toFixed(2), controllers.toFixed(2)].join(" | "),
  );
  const header = "figure | lab | simulator | error of a run | rank correlation of runs | of controllers";
  process.stdout.write(`${runs.length} runs\n\n| ${header} |\n|---|---:|---:|---:|---:|---:|\n`);
  for (const row of rows) process.stdout.write(`| ${row} |\n`);
}

/** The report's figures of complete runs, by folder name. */
function reported(folder: string): Map<string, LabRun["figures"]> {
  const path = join(folder, "runs.csv");
  if (!existsSync(path)) throw new Error(`There is no ${path}: make the report with tigas report ${folder}.`);
  const rows = csv(readFileSync(path, "utf8"), { type: "csv" }) as Record<string, string>[];
  const figures = (row: Record<string, string>) =>
    Object.fromEntries(PAIRS.map(([name]) => [name, Number(row[name] || Number.NaN)]));
  return new Map(rows.filter(({ status }) => status === "complete").map((row) => [row.folder ?? "", figures(row)]));
}

function read(folder: string): Omit<LabRun, "figures"> {
  const lines = (name: string) =>
    readFileSync(join(folder, `${name}.ndjson`), "utf8")
      .split("\n")
      .filter(Boolean)
      .map((line) => JSON.parse(line));
  const { configuration, recording, server } = JSON.parse(readFileSync(join(folder, "run.json"), "utf8"));
  const { network, profile, seed, reprojection, prediction } = configuration;
  if (configuration.mode !== "stateless" || reprojection || prediction !== "off") {
    throw new Error(`${folder} is not a run in the mode stateless without reprojection and prediction.`);
  }
  const roundTrip = network.link ? 2 * network.link.delay_ms : network.rtt_ms;
  if (roundTrip === null) throw new Error(`${folder} has no network, or the round trips of its trace; give --rtt.`);
  return {
    network: network.trace ?? JSON.stringify(network.link),
    roundTrip,
    constant: network.link,
    controller: typeof profile === "number" ? `fixed:${profile}` : profile,
    pixels: recording.lens.width * recording.lens.height,
    seed,
    duration: recording.duration_ms,
    displayInterval: recording.display_interval_ms,
    ladder: server.ladder,
    frames: lines("replies")
      .filter(({ server: timing, rung }) => timing && rung !== null)
      .map(({ rung, bytes, server: { render, encode } }) => ({ rung, bytes, render, encode })),
    link: lines("link").map(({ at, target_kbps }) => ({ at, target_kbps })),
    points: lines("inputs").map(({ at, position, quaternion }) => ({ t_ms: at, position, quaternion })),
  };
}

await main();
