import { expect, test } from "vitest";
import type { ViewRequest } from "./pipeline";
import { Rest } from "./rest";

const VIEW: ViewRequest = {
  scene: "here",
  fx: 500,
  fy: 500,
  cx: 320,
  cy: 180,
  width: 640,
  height: 360,
  profile: 3,
  overscan: 0.1,
};
const [CONTROLLER, ANOTHER] = [{}, {}];

/** The request that follows an earlier one. */
function then(changes: Partial<ViewRequest>, chooser: unknown = CONTROLLER): ViewRequest {
  const rest = new Rest();
  rest.view(VIEW, CONTROLLER);
  return rest.view({ ...VIEW, ...changes }, chooser);
}

test.each([{ profile: 5 }, { overscan: 0.05 }, { profile: 4, overscan: 0 }])(
  "at rest the same view is not requested with less: %o",
  (changes) => expect(then(changes)).toBe(VIEW),
);

test.each([
  { profile: 2 },
  { overscan: 0.2 },
  { profile: 2, overscan: 0 },
  { azimuth: 1, profile: 5 },
  { depth: true },
])("at rest more of it is requested, and in motion another view: %o", (changes) =>
  expect(then(changes)).toEqual({ ...VIEW, ...changes }),
);

test("a worse rung that a person has chosen is shown at once", () => {
  expect(then({ profile: 5 }, ANOTHER).profile).toBe(5);
});

test("of a video, a better bit rate is worth another frame of the same view, and a worse one is not", () => {
  const rest = new Rest();
  const at = (bitrate_kbps: number) => ({ ...VIEW, format: "h264" as const, video: { bitrate_kbps } });
  const first = rest.view(at(2000), CONTROLLER);
  expect(rest.view(at(1000), CONTROLLER)).toBe(first);
  expect(rest.view(at(3000), CONTROLLER)).toEqual(at(3000));
});
