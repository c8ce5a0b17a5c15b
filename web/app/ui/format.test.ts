import { expect, test } from "vitest";
import { bitrate, bytes, count } from "./format";

test.each([
  [count, 0, "0"],
  [count, 999, "999"],
  [count, 1234, "1.2 k"],
  [count, 241_310, "241 k"],
  [count, 999_600, "1 M"],
  [count, 4_200_000, "4.2 M"],
  [bytes, 0, "0 B"],
  [bytes, 512, "512 B"],
  [bytes, 41_234, "41 kB"],
  [bytes, 6_178_487, "6.2 MB"],
  [bytes, 1_200_000_000, "1.2 GB"],
  [bitrate, 850_000, "850 kbit/s"],
  [bitrate, 1_700_000, "1.7 Mbit/s"],
  [bitrate, 240_000_000, "240 Mbit/s"],
  [bitrate, 2_500_000_000, "2.5 Gbit/s"],
])("%o of %i is %s", (format, value, text) => {
  expect(format(value)).toBe(text);
});
