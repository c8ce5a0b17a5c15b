import { expect, test } from "vitest";
import type { ControllerFactory } from "#client/abr/controller";
import { PAPER_LADDER } from "#client/abr/ladder";
import { SeenController } from "#client/abr/seen";
import type { Rung } from "#client/wire/render";
import type { TimedPose } from "#viewer/movement/movement";
import { orientation } from "#viewer/view/camera";
import { PaperEndpoints } from "./endpoints";
import { type HeadOptions, type Visit, visit } from "./heads";
import { parseTrace } from "./trace";

/** Looks back and forth, 80° to each side and back every two seconds. */
const POINTS: readonly TimedPose[] = Array.from({ length: 121 }, (_, i) => ({
  t_ms: i * 50,
  position: [0, 0, -4],
  quaternion: [...orientation(80 * Math.sin((i * Math.PI) / 20), 0)] as [number, number, number, number],
}));

const SEEDS = [1, 2, 3, 4, 5];
const LADDER: readonly Rung[] = [...PAPER_LADDER, { name: "", width: 256, height: 144, quality: 10, expected_kb: 2.4 }];

type Options = Partial<Pick<HeadOptions, "controller" | "warmUp" | "seed">>;

function visitOf(trace: string, surround: boolean, options: Options = {}): Promise<Visit> {
  const { controller = (context) => new SeenController(context), warmUp = 0, seed = 1 } = options;
  return visit({
    controller,
    trace: parseTrace(trace),
    ladder: LADDER,
    roundTrip: 100,
    endpoints: new PaperEndpoints(LADDER, seed + 2),
    points: POINTS,
    warmUp,
    duration: 6000,
    surround,
    seed,
  });
}

/** Seen's rungs, animation frame by animation frame, in a separate visit. */
async function seenRungs(trace: string, seed: number): Promise<readonly number[]> {
  const rungs: number[] = [];
  const controller: ControllerFactory = (context) => {
    const seen = new SeenController(context);
    const decide = (now: number) => {
      const rung = seen.decide(now);
      rungs.push(rung);
      return rung;
    };
    return { decide, observe: (observation) => seen.observe(observation) };
  };
  await visitOf(trace, false, { controller, seed });
  return rungs;
}

/** Replays the same rungs. */
function replaying(rungs: readonly number[]): ControllerFactory {
  return () => {
    const left = rungs.values();
    return { decide: () => left.next().value ?? 0, observe: () => undefined };
  };
}

test("in an outage a turn shows what nobody rendered, unless there is a surround", async () => {
  const trace = "t_ms,down_kbps\n0,8000\n2100,0\n4500,8000\n9000,";
  expect((await visitOf(trace, false, { warmUp: 2000 })).never).toBeGreaterThan(0.05);
  expect((await visitOf(trace, true, { warmUp: 2000 })).never).toBeLessThan(0.002);
});

test("on a link that takes a second for a picture, a moment of rest leaves nothing dark in the outage that follows", async () => {
  const { never } = await visitOf("t_ms,down_kbps\n0,100\n3000,0\n8000,100\n9000,", true, { warmUp: 3000 });
  expect(never).toBeLessThan(0.002);
});

// The rungs of another visit: any small delay would lead Seen to different rungs from then on, better or worse by chance.
test.each([1000, 4000, 20_000])(
  "at Seen's rungs a surround hardly delays the view's frames at %i kbit/s",
  async (kbps) => {
    const trace = `t_ms,down_kbps\n0,${kbps}\n9000,`;
    const visits = { without: [] as Visit[], surrounded: [] as Visit[] };
    for (const seed of SEEDS) {
      const controller = replaying(await seenRungs(trace, seed + 100));
      visits.without.push(await visitOf(trace, false, { controller, seed }));
      visits.surrounded.push(await visitOf(trace, true, { controller, seed }));
    }
    const mean = (of: readonly Visit[], figure: keyof Visit) =>
      of.reduce((sum, each) => sum + each[figure], 0) / of.length;
    const { without, surrounded } = visits;
    expect(mean(surrounded, "response")).toBeLessThan(1.08 * mean(without, "response"));
    expect(mean(surrounded, "framesPerSecond")).toBeGreaterThan(0.9 * mean(without, "framesPerSecond"));
    expect(mean(surrounded, "never")).toBeLessThan(1.05 * mean(without, "never") + 0.001);
    expect(mean(surrounded, "aside")).toBeGreaterThan(0);
    expect(mean(surrounded, "aside")).toBeLessThan(0.05 * (kbps / 1000));
  },
);
