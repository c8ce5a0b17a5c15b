import { expect, test } from "vitest";
import { draftOf, parseLink } from "./link-form";

const draft = { down: "20", up: "5", rtt: "50", jitter: "3", loss: "1" };

test("a round trip is twice the delay, and rates are kbit/s on the wire", () => {
  expect(parseLink(draft)).toEqual({
    setting: { down_kbps: 20_000, up_kbps: 5000, delay_ms: 25, jitter_ms: 3, loss_pct: 1 },
  });
});

test("takes decimals with point or comma, spaces around, and an outage", () => {
  expect(parseLink({ down: " 0 ", up: "2,5", rtt: ".5", jitter: "0", loss: "0.1" })).toMatchObject({
    setting: { down_kbps: 0, up_kbps: 2500, delay_ms: 0.25, loss_pct: 0.1 },
  });
});

test.each(["", " ", "-1", "fast", "1e9", "NaN", "Infinity", "0x10", "1.2.3", "100001"])(
  "refuses %j as a rate",
  (down) => {
    expect(parseLink({ ...draft, down })).toEqual({
      problems: { down: "Down must be a number from 0 to 100,000 Mbit/s." },
    });
  },
);

test("says everything that is wrong at once", () => {
  expect(parseLink({ down: "x", up: "5", rtt: "120001", jitter: "-1", loss: "101" })).toEqual({
    problems: {
      down: "Down must be a number from 0 to 100,000 Mbit/s.",
      rtt: "Round trip must be a number from 0 to 120,000 ms.",
      jitter: "Jitter must be a number from 0 to 60,000 ms.",
      loss: "Loss must be a number from 0 to 100 %.",
    },
  });
});

test("shows the link in force, and takes it back as it was", () => {
  const link = { down_kbps: 27_600, up_kbps: 1234.6, delay_ms: 12.5, jitter_ms: 2.5, loss_pct: 0.25 };
  expect(draftOf(link)).toEqual({ down: "27.6", up: "1.235", rtt: "25", jitter: "2.5", loss: "0.25" });
  expect(parseLink(draftOf({ ...link, up_kbps: 1200 }))).toEqual({ setting: { ...link, up_kbps: 1200 } });
});
