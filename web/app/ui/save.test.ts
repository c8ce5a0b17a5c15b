import { expect, test } from "vitest";
import { fileName } from "./save";

test.each([
  ["Bus, 100 ms", "Bus-100-ms.json"],
  ["../../etc/passwd", "etc-passwd.json"],
  ["größer", "größer.json"],
  ["///", "experiment.json"],
])("%s is saved as %s", (words, name) => {
  expect(fileName(words, "json")).toBe(name);
});
