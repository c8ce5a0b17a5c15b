// How much of the picture nobody rendered, for recorded heads over simulated networks, with and without a surround (docs/reprojection.md).
import { readFileSync, writeFileSync } from "node:fs";
import { basename } from "node:path";
import { parseArgs } from "node:util";
import { number } from "./arguments.mjs";
import { load } from "./page-module.mjs";

const USAGE = `npm run heads-sim -- [options] --network TRACE.csv... MOVEMENT.csv...
  --network FILE      a network trace; may be repeated
  --controller NAME   as abr-sim takes it [budget]
  --ladder FILE       a scene's ladder.json (docs/ladder.md) [the paper's]
  --rtt MS            [100]
  --seconds N         of each visit, after a rest [8]
  --rest N            seconds before the viewer moves [2]
  --visits N          of each movement over each network, at parts of both that are spread evenly [3]
  --scale X           frames are so many times as large as the ladder says: margins are more pixels [1.3]
  --seed N            [1]
  --held              each network from its beginning, held at its first state until the viewer moves, as in experiments
  --each              a row for each network
  --json FILE         every visit
`;

const COLUMNS = [
  ["never rendered", ({ never }) => percent(never)],
  ["of content < 0.5 s", ({ neverFresh }) => percent(neverFresh)],
  ["beyond the frame", ({ uncovered }) => percent(uncovered)],
  ["content age, ms", ({ contentAge }) => contentAge.toFixed(0)],
  ["response, ms", ({ response }) => response.toFixed(1)],
  ["frames/s", ({ framesPerSecond }) => framesPerSecond.toFixed(2)],
  ["rung", ({ rung }) => rung.toFixed(2)],
  ["Mbit/s", ({ bandwidth }) => bandwidth.toFixed(2)],
  ["of the surround", ({ aside }) => aside.toFixed(3)],
];

async function main() {
  const { values, positionals } = parseArgs({
    allowPositionals: true,
    options: {
      network: { type: "string", multiple: true },
      controller: { type: "string", default: "budget" },
      ladder: { type: "string" },
      rtt: { type: "string", default: "100" },
      seconds: { type: "string", default: "8" },
      rest: { type: "string", default: "2" },
      visits: { type: "string", default: "3" },
      scale: { type: "string", default: "1.3" },
      seed: { type: "string", default: "1" },
      held: { type: "boolean", default: false },
      each: { type: "boolean", default: false },
      json: { type: "string" },
      help: { type: "boolean", default: false },
    },
  });
  if (values.help || positionals.length === 0 || !values.network) return process.stdout.write(USAGE);
  const [heads, traces, controllers, paper, endpoints, movements, intervals, random] = await Promise.all(
    [
      "simulator/heads",
      "simulator/trace",
      "simulator/controllers",
      "abr/ladder",
      "simulator/endpoints",
      "movement/movement",
      "simulator/bootstrap",
      "abr/random",
    ].map(load),
  );
  const ladder =
    values.ladder === undefined ? paper.PAPER_LADDER : JSON.parse(readFileSync(values.ladder, "utf8")).rungs;
  const [seed, duration, warmUp, visits] = [
    number("--seed", values.seed),
    number("--seconds", values.seconds) * 1000,
    number("--rest", values.rest) * 1000,
    number("--visits", values.visits),
  ];
  const rows = [];
  for (const [person, head] of positionals.entries()) {
    const { points } = movements.readMovement(readFileSync(head, "utf8"), basename(head));
    const spare = Math.max(0, (points.at(-1)?.t_ms ?? 0) - duration);
    for (const network of values.network) {
      const trace = traces.parseTrace(readFileSync(network, "utf8"));
      for (let part = 0; part < visits; part++) {
        const begin = (spare * (part + 0.5)) / visits;
        const options = {
          controller: controllers.controllerFactory(values.controller),
          trace: values.held
            ? traces.held(trace, warmUp)
            : traces.from(trace, (trace.duration * (part + 0.5)) / visits),
          ladder,
          roundTrip: number("--rtt", values.rtt),
          points: points.map((point) => ({ ...point, t_ms: point.t_ms - begin })),
          warmUp,
          duration,
          seed: seed + 1000 * person + 10 * part, // or else all would meet the same frame sizes
        };
        for (const surround of [false, true]) {
          const scale = number("--scale", values.scale);
          const ends = new endpoints.PaperEndpoints(ladder, options.seed + 2, { scale });
          const figures = await heads.visit({ ...options, surround, endpoints: ends });
          rows.push({ head: basename(head, ".csv"), network: basename(network, ".csv"), part, surround, figures });
        }
      }
    }
  }
  const groups = [...(values.each ? [...new Set(rows.map(({ network }) => network))] : []), null];
  const lines = groups.flatMap((group) =>
    [false, true].map((surround) => {
      const own = rows.filter((row) => row.surround === surround && (group === null || row.network === group));
      return [group ?? "all", surround ? "with" : "without", ...COLUMNS.map(([, show]) => show(mean(own)))];
    }),
  );
  const header = ["network", "surround", ...COLUMNS.map(([title]) => title)];
  process.stdout.write(`| ${header.join(" | ")} |\n|${"---|".repeat(header.length)}\n`);
  for (const line of lines) process.stdout.write(`| ${line.join(" | ")} |\n`);
  // People are independent of each other; what one of them does is not.
  const people = [...new Set(rows.map(({ head }) => head))];
  const of = (head, surround) => mean(rows.filter((row) => row.head === head && row.surround === surround));
  const tell = (title, figure, show) => {
    const { mean: middle, low, high } = intervals.bootstrap(people.map(figure), random.seeded(seed));
    process.stdout.write(`\n${title}: ${show(middle)} [${show(low)}, ${show(high)}]`);
  };
  process.stdout.write(`\n${people.length} people, with 95 % bootstrap intervals`);
  tell("never rendered, without", (head) => of(head, false).never, percent);
  tell("never rendered, with", (head) => of(head, true).never, percent);
  const later = (head) => of(head, true).response / of(head, false).response - 1;
  tell("longer responses with a surround", later, percent);
  process.stdout.write("\n");
  if (values.json !== undefined) writeFileSync(values.json, `${JSON.stringify({ options: values, rows }, null, 1)}\n`);
}

/** Of each figure, where it is one. */
function mean(rows) {
  const names = Object.keys(rows[0].figures);
  const of = (name) => rows.map(({ figures }) => figures[name]).filter(Number.isFinite);
  return Object.fromEntries(names.map((name) => [name, of(name).reduce((a, b) => a + b, 0) / of(name).length]));
}

function percent(share) {
  return `${(100 * share).toFixed(2)} %`;
}

try {
  await main();
} catch (error) {
  process.stderr.write(`${error.message}\n`);
  process.exitCode = 1;
}
