// Runs controllers over network traces in the simulator (docs/adaptation.md) and prints a table; --json and --plot write files.
import { readFileSync, writeFileSync } from "node:fs";
import { basename, resolve } from "node:path";
import { parseArgs } from "node:util";
import { number, runScript, SERVER, serverOptions } from "./arguments.mjs";
import { load, run } from "./page-module.mjs";

const USAGE = `npm run abr-sim -- [options] TRACE.csv...
  --controller NAME   seen, latency, latency-transfer, lol+, l2a, fixed:RUNG, one with other parameters (as in
                      l2a@horizon=8,react=4), or a file with a default export that makes a controller; may be
                      repeated [all but fixed]
  --rtt MS            round trip in place of the traces' own delay; may be repeated
  --seconds N         how long each visit lasts [each trace once]
  --render MS         the server's time for a frame [11, the paper's RTX 2060 Super]
  --render-best MS    for one of the best rung, where the server takes longer for more pixels [as --render]
  --scale X           frames are so many times as large as the ladder says [1]
  --ladder FILE       a scene's ladder.json (docs/adaptation.md) [the paper's]
  --batch MS          the page hears of what has arrived every so many milliseconds [at once]
  --way WAY           how the page shows a frame that is older than the view: stale, rotation, depth, or predicted,
                      which is with depth, too [predicted]
  --seed N            [1]
  --each              a row for each trace, besides the mean over all
  --json FILE, --plot FILE.svg
`;

async function main() {
  const { values, positionals } = parseArgs({
    allowPositionals: true,
    options: {
      controller: { type: "string", multiple: true },
      rtt: { type: "string", multiple: true },
      seconds: { type: "string" },
      ...SERVER,
      ladder: { type: "string" },
      way: { type: "string", default: "predicted" },
      seed: { type: "string", default: "1" },
      each: { type: "boolean", default: false },
      json: { type: "string" },
      plot: { type: "string" },
      help: { type: "boolean", default: false },
    },
  });
  if (values.help || positionals.length === 0) return process.stdout.write(USAGE);
  const [
    { simulate },
    { parseTrace },
    { controllerFactory },
    { table, overTraces },
    { PAPER_LADDER },
    { PaperEndpoints },
    { INTERACTIVE_MS },
    { WAYS },
    { CONTROLLER_NAMES },
  ] = await Promise.all(
    [
      "tools/simulator/simulate",
      "tools/simulator/trace",
      "tools/simulator/controllers",
      "tools/simulator/report",
      "packages/client/abr/ladder",
      "tools/simulator/endpoints",
      "packages/client/wire/figures",
      "packages/client/abr/controller",
      "packages/client/abr/registry",
    ].map(load),
  );
  const seed = number("--seed", values.seed);
  const ladder = values.ladder === undefined ? PAPER_LADDER : JSON.parse(readFileSync(values.ladder, "utf8")).rungs;
  if (!WAYS.includes(values.way)) throw new Error(`--way is one of ${WAYS.join(", ")}, not "${values.way}".`);
  const paper = serverOptions(values);
  const factories = await Promise.all(
    (values.controller ?? CONTROLLER_NAMES).map(async (name) =>
      name.endsWith(".ts")
        ? [basename(name, ".ts"), (await run(resolve(name))).default]
        : [name, controllerFactory(name)],
    ),
  );
  const roundTrips = values.rtt?.map((text) => number("--rtt", text)) ?? [null];
  const runs = [];
  for (const path of positionals) {
    const trace = parseTrace(readFileSync(path, "utf8"));
    for (const roundTrip of roundTrips) {
      for (const [controller, create] of factories) {
        const figures = await simulate({
          controller: create,
          trace,
          ladder,
          duration: values.seconds === undefined ? trace.duration : number("--seconds", values.seconds) * 1000,
          roundTrip,
          endpoints: new PaperEndpoints(ladder, seed + 2, paper),
          way: values.way,
          seed,
        });
        runs.push({ trace: basename(path, ".csv"), controller, roundTrip, figures });
      }
    }
  }
  const means = overTraces(runs);
  process.stdout.write(`${table(values.each || positionals.length === 1 ? runs : means)}\n`);
  if (values.each && positionals.length > 1) process.stdout.write(`\n${table(means)}\n`);
  if (values.json !== undefined) writeFileSync(values.json, `${JSON.stringify({ options: values, runs }, null, 1)}\n`);
  if (values.plot !== undefined) writeFileSync(values.plot, await plot(runs, INTERACTIVE_MS));
}

/** Figures against the round trip, or for each trace where there is only one. */
async function plot(runs, interactive) {
  const [{ parse, View }, { compile }] = await Promise.all([import("vega"), import("vega-lite")]);
  const byTrip = new Set(runs.map(({ roundTrip }) => roundTrip)).size > 1;
  const values = runs.flatMap(({ figures, roundTrip, ...rest }) =>
    [
      [`poses within ${interactive} ms, %`, figures.inTime * 100],
      ["response time p95, ms", figures.responseP95],
      ["mean rung (0 is the best)", figures.rungOverTime],
      ["switches a minute", figures.switches],
      ["frames a second", figures.framesPerSecond],
    ].map(([figure, value]) => ({ ...rest, roundTrip: roundTrip ?? "", figure, value })),
  );
  const specification = {
    data: { values },
    facet: { field: "figure", title: null, sort: null },
    columns: 1,
    spec: {
      width: 640,
      height: 120,
      mark: byTrip ? { type: "line", point: true } : "bar",
      encoding: {
        x: byTrip
          ? { field: "roundTrip", type: "quantitative", title: "round trip, ms" }
          : { field: "trace", type: "nominal", title: null },
        ...(!byTrip && { xOffset: { field: "controller" } }),
        y: { field: "value", aggregate: "mean", title: null },
        color: { field: "controller", title: "controller", sort: null },
      },
    },
    resolve: { scale: { y: "independent" } },
  };
  return await new View(parse(compile(specification).spec), { renderer: "none" }).toSVG();
}

await runScript(main);
