import { expect, test } from "vitest";
import { BudgetController } from "../abr/budget";
import type { ControllerFactory } from "../abr/controller";
import { FixedController } from "../abr/fixed";
import { PAPER_LADDER } from "../abr/ladder";
import type { TimedPose } from "../movement/playback";
import { orientation } from "../view/camera";
import type { Rung } from "../wire/render";
import { PaperEndpoints } from "./endpoints";
import { type Visit, visit } from "./heads";
import { parseTrace } from "./trace";

/** Looks to and fro, 80° to each side and back every two seconds. */
const POINTS: readonly TimedPose[] = Array.from({ length: 121 }, (_, i) => ({
  t_ms: i * 50,
  position: [0, 0, -4],
  quaternion: [...orientation(80 * Math.sin((i * Math.PI) / 20), 0)] as [number, number, number, number],
}));

const LADDER: readonly Rung[] = [...PAPER_LADDER, { name: "", width: 256, height: 144, quality: 10, expected_kb: 2.4 }];

async function visits(
  trace: string,
  warmUp: number,
  controller: ControllerFactory = (context) => new BudgetController(context),
): Promise<{ without: Visit; surrounded: Visit }> {
  const each = [false, true].map((surround) =>
    visit({
      controller,
      trace: parseTrace(trace),
      ladder: LADDER,
      roundTrip: 100,
      endpoints: new PaperEndpoints(LADDER, 3),
      points: POINTS,
      warmUp,
      duration: 6000,
      surround,
      seed: 1,
    }),
  );
  const [without, surrounded] = (await Promise.all(each)) as [Visit, Visit];
  return { without, surrounded };
}

test("in an outage a turn shows what nobody rendered, unless there is a surround", async () => {
  const { without, surrounded } = await visits("t_ms,down_kbps\n0,8000\n2100,0\n4500,8000\n9000,", 2000);
  expect(without.never).toBeGreaterThan(0.05);
  expect(surrounded.never).toBeLessThan(0.002);
});

// At the same rung: which one a controller takes is another matter.
test.each([
  [1000, 4],
  [4000, 3],
  [20_000, 2],
])("the view's frames come as soon and as often at %i kbit/s", async (kbps, rung) => {
  const { without, surrounded } = await visits(`t_ms,down_kbps\n0,${kbps}\n9000,`, 0, () => new FixedController(rung));
  expect(surrounded.response).toBeLessThan(1.05 * without.response);
  expect(surrounded.framesPerSecond).toBeGreaterThan(0.95 * without.framesPerSecond);
  expect(surrounded.never).toBeLessThan(without.never + 0.001);
  expect(surrounded.aside).toBeGreaterThan(0);
  expect(surrounded.aside).toBeLessThan(0.05 * (kbps / 1000));
});
