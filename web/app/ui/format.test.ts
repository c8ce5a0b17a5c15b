import { expect, test } from "vitest";
import { bitrate, bytes, count } from "./format";

test.each([
  [0, "0"],
  [999, "999"],
  [1234, "1.2 k"],
  [241_310, "241 k"],
  [999_600, "1 M"],
  [4_200_000, "4.2 M"],
])("count %i is %s", (value, text) => {
  expect(count(value)).toBe(text);
});

test.each([
  [0, "0 B"],
  [512, "512 B"],
  [41_234, "41 kB"],
  [6_178_487, "6.2 MB"],
  [1_200_000_000, "1.2 GB"],
])("%i bytes are %s", (value, text) => {
  expect(bytes(value)).toBe(text);
});

test.each([
  [850_000, "850 kbit/s"],
  [1_700_000, "1.7 Mbit/s"],
  [240_000_000, "240 Mbit/s"],
  [2_500_000_000, "2.5 Gbit/s"],
])("%i bits a second are %s", (value, text) => {
  expect(bitrate(value)).toBe(text);
});
