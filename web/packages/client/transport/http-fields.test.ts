import { expect, test } from "vitest";
import { frameHeader } from "./http-fields";

test("reads what the server says about a frame", () => {
  const headers = new Headers({
    "Content-Type": "image/jpeg",
    "Tigas-Frame": "seq=41, width=832, height=468, margin_x=96, margin_y=54, profile=2, coarse=1",
    "Server-Timing": "queue;dur=0.25, render;dur=12.5, encode;dur=1.75",
  });
  expect(frameHeader(200, headers)).toEqual({
    status: 200,
    seq: 41,
    content_type: "image/jpeg",
    width: 832,
    height: 468,
    margin_x: 96,
    margin_y: 54,
    profile: 2,
    coarse: true,
    timing: { queue: 0.25, render: 12.5, encode: 1.75 },
    requests_per_s: null,
  });
});

test("a proxy may drop headers: what is not said is not known", () => {
  expect(frameHeader(200, new Headers())).toMatchObject({
    seq: 0,
    width: null,
    margin_x: null,
    coarse: null,
    profile: null,
    timing: null,
  });
});

test.each([["queue;dur=1, render;dur=2"], ["queue;dur=x, render;dur=2, encode;dur=3"], ["cache;desc=hit"], [";;;,,,"]])(
  "half a timing is none: %s",
  (field) => {
    expect(frameHeader(200, new Headers({ "Server-Timing": field })).timing).toBeNull();
  },
);

test("a description beside the duration does no harm", () => {
  const field = 'queue;desc="waiting";dur=1, render;dur=2;desc=x, encode;dur=3';
  expect(frameHeader(200, new Headers({ "Server-Timing": field })).timing).toEqual({ queue: 1, render: 2, encode: 3 });
});
