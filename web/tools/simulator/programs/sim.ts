/** Runs controllers over network traces in the simulator (docs/adaptation.md) and prints a table; --json and --plot write files. */
import { readFileSync, writeFileSync } from "node:fs";
import { basename, resolve } from "node:path";
import { parseArgs } from "node:util";
import type { TopLevelSpec } from "vega-lite";
import { CONTROLLER_NAMES } from "#client/abr/registry";
import { INTERACTIVE_MS } from "#client/wire/figures";
import { controllerFactory } from "../controllers";
import { PaperEndpoints } from "../endpoints";
import { overTraces, type Run, table } from "../report";
import { simulate } from "../simulate";
import { parseTrace } from "../trace";
import { number, SHARED, shared } from "./options";

const USAGE = `npm run abr-sim -- [options] TRACE.csv...
  --controller NAME   seen, latency, latency-transfer, lol+, l2a, fixed:RUNG, one with other parameters (such as
                      l2a@horizon=8,react=4), or a file with a default export that makes a controller; may be
                      repeated [all but fixed]
  --rtt MS            round trip in place of the traces' own delay; may be repeated
  --seconds N         how long each visit lasts [each trace once]
  --render MS         the server's time per frame [11, the paper's RTX 2060 Super]
  --render-best MS    the time for the best rung, if the server takes longer for more pixels [as --render]
  --scale X           size of frames, as a multiple of the ladder's [1]
  --ladder FILE       a scene's ladder.json (docs/adaptation.md) [the paper's]
  --batch MS          interval at which the page sees arrived data [at once]
  --way WAY           how the page shows a frame that is older than the view: stale, rotation, depth, or predicted,
                      which also uses depth [predicted]
  --seed N            [1]
  --each              a row for each trace, in addition to the mean over all
  --json FILE, --plot FILE.svg
`;

async function main(): Promise<void> {
  const { values, positionals } = parseArgs({
    allowPositionals: true,
    options: {
      ...SHARED,
      rtt: { type: "string", multiple: true },
      seconds: { type: "string" },
      each: { type: "boolean", default: false },
      plot: { type: "string" },
    },
  });
  if (values.help || positionals.length === 0) return void process.stdout.write(USAGE);
  const { way, ladder, server, seed } = shared(values);
  const factories = await Promise.all(
    (values.controller ?? CONTROLLER_NAMES).map(async (name) =>
      name.endsWith(".ts")
        ? { controller: basename(name, ".ts"), create: (await import(resolve(name))).default }
        : { controller: name, create: controllerFactory(name) },
    ),
  );
  const roundTrips = values.rtt?.map((text) => number("--rtt", text)) ?? [null];
  const runs: Run[] = [];
  for (const path of positionals) {
    const trace = parseTrace(readFileSync(path, "utf8"));
    for (const roundTrip of roundTrips) {
      for (const { controller, create } of factories) {
        const figures = await simulate({
          controller: create,
          trace,
          ladder,
          duration: values.seconds === undefined ? trace.duration : number("--seconds", values.seconds) * 1000,
          roundTrip,
          endpoints: new PaperEndpoints(ladder, seed + 2, server),
          way,
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
  if (values.plot !== undefined) writeFileSync(values.plot, await plot(runs));
}

/** Figures by round trip, or by trace if there is only one round trip. */
async function plot(runs: readonly Run[]): Promise<string> {
  const [{ parse, View }, { compile }] = await Promise.all([import("vega"), import("vega-lite")]);
  const byTrip = new Set(runs.map(({ roundTrip }) => roundTrip)).size > 1;
  const values = runs.flatMap(({ figures, roundTrip, ...rest }) =>
    [
      [`poses within ${INTERACTIVE_MS} ms, %`, figures.inTime * 100],
      ["response time p95, ms", figures.responseP95],
      ["mean rung (0 is the best)", figures.rungOverTime],
      ["switches a minute", figures.switches],
      ["frames a second", figures.framesPerSecond],
    ].map(([figure, value]) => ({ ...rest, roundTrip: roundTrip ?? "", figure, value })),
  );
  const specification: TopLevelSpec = {
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

await main();
