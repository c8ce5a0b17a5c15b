import { expect, test } from "vitest";
import { cover } from "./geometry";

test("a picture of the display's shape is shown whole", () => {
  expect(cover({ width: 640, height: 360 }, { width: 1280, height: 720 })).toEqual({
    across: { origin: 0, step: 0.5, length: 640 },
    down: { origin: 0, step: 0.5, length: 360 },
  });
});

test("what is too wide is cut off left and right, what is too high above and below", () => {
  const square = { width: 180, height: 180 };
  expect(cover({ width: 320, height: 180 }, square)).toEqual({
    across: { origin: 70, step: 1, length: 320 },
    down: { origin: 0, step: 1, length: 180 },
  });
  expect(cover(square, { width: 320, height: 180 }).down).toMatchObject({ origin: (180 - 180 * 0.5625) / 2 });
});
