import { expect, test } from "vitest";
import { FixedController } from "./controller";

test("stays where it was put, whatever it hears", () => {
  const subject = new FixedController(2);
  subject.observe();
  expect(subject.decide()).toBe(2);
});
