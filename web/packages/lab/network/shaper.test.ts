import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { CONSTANT } from "#fakes/shaper";
import { NO_STATS } from "#viewer/stateless/stats";
import { frames, Shaper, stepPath } from "./shaper";

class FakeEvents {
  static readonly CLOSED = 2;
  static all: FakeEvents[] = [];
  readyState = 1;
  onopen = () => undefined;
  onmessage = (_: { data: string }) => undefined;
  onerror = () => undefined;
  constructor() {
    FakeEvents.all.push(this);
  }
  close() {
    this.readyState = FakeEvents.CLOSED;
  }
}

beforeEach(() => {
  vi.useFakeTimers();
  vi.spyOn(performance, "now").mockReturnValue(1000);
  FakeEvents.all = [];
  vi.stubGlobal("EventSource", FakeEvents);
});

afterEach(() => {
  vi.useRealTimers();
});

function watched() {
  const subject = new Shaper("http://lab:8090", "http://lab:8080/");
  const [events] = FakeEvents.all;
  if (!events) throw new Error("nobody watches");
  return { subject, events };
}

test("what comes is the status and the chart's next sample", () => {
  const { subject, events } = watched();
  events.onmessage({ data: JSON.stringify(CONSTANT) });
  expect(subject.status.value).toEqual(CONSTANT);
  expect(subject.rates.value).toEqual([[1], [8], [7]]);
});

test("a shaper that goes says so; one that refuses to be watched is asked again", () => {
  const { subject, events } = watched();
  events.onmessage({ data: JSON.stringify(CONSTANT) });
  events.readyState = 0;
  events.onerror();
  expect(subject.status.value).toBeNull();
  expect(subject.connectionError.value).toContain("is not responding");
  vi.advanceTimersByTime(10_000);
  expect(FakeEvents.all).toHaveLength(1);
  events.readyState = FakeEvents.CLOSED;
  events.onerror();
  vi.advanceTimersByTime(10_000);
  expect(FakeEvents.all).toHaveLength(2);
});

test("nothing is asked once it is disposed of", () => {
  const { subject, events } = watched();
  events.readyState = FakeEvents.CLOSED;
  events.onerror();
  subject.dispose();
  vi.advanceTimersByTime(60_000);
  expect(FakeEvents.all).toHaveLength(1);
});

test("a refused action leaves the status and says why, until one succeeds", async () => {
  const { subject, events } = watched();
  events.onmessage({ data: JSON.stringify(CONSTANT) });
  const problem = { type: "tigas:x", title: "", status: 409, detail: "No trace is playing." };
  vi.stubGlobal("fetch", async () => Response.json(problem, { status: 409 }));
  await subject.act((api) => api.pause());
  expect(subject.actionError.value).toBe("No trace is playing.");
  expect(subject.status.value).toEqual(CONSTANT);
  vi.stubGlobal("fetch", async () => Response.json({ ...CONSTANT, loop: true }));
  await subject.act((api) => api.loop(true));
  expect(subject.actionError.value).toBeNull();
  expect(subject.status.value?.loop).toBe(true);
});

describe("series", () => {
  test("a still picture has neither size nor latency", () => {
    const stats = {
      ...NO_STATS,
      shown: 7,
      roundTrip: 40,
      frame: { bytes: 52_000, width: 1, height: 1, profile: 0 },
    };
    expect(frames(stats, 6)).toEqual([52, 40]);
    expect(frames(stats, 7)).toEqual([null, null]);
  });

  test("a trace is drawn as steps, its highest rate at the top", () => {
    expect(stepPath([0, 500], [10, 5], 1000, [100, 20])).toBe("M0 0.0H50.0V10.0H100.0");
  });

  test("an outage from start to end is a line at the bottom", () => {
    expect(stepPath([0], [0], 1000, [100, 20])).toBe("M0 20.0H100.0");
  });
});
