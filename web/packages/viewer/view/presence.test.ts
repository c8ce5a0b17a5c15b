import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { LEFT_AFTER, Presence } from "./presence";

let page: Document & { hidden: boolean };
let window: EventTarget;
let presence: Presence;

beforeEach(() => {
  vi.useFakeTimers();
  page = Object.assign(new EventTarget(), { hidden: false }) as unknown as Document & { hidden: boolean };
  window = new EventTarget();
  presence = new Presence(page, window);
});

afterEach(() => {
  presence.dispose();
  vi.useRealTimers();
});

function hide(hidden: boolean): void {
  page.hidden = hidden;
  page.dispatchEvent(new Event("visibilitychange"));
}

test("frames that are late, but seen, are no gap: a slow page is to be measured", () => {
  expect([0, 16, 900].map((at) => presence.gap(at))).toEqual([0, 0, 0]);
});

test("the time in which the page was hidden is a gap, however short it was", () => {
  presence.gap(0);
  hide(true);
  hide(false);
  expect([300, 316].map((at) => presence.gap(at))).toEqual([300, 0]);
});

test("so is that in which a machine slept, of which browsers tell nothing", () => {
  expect([0, 30_000, 30_016].map((at) => presence.gap(at))).toEqual([0, 30_000, 0]);
});

test("a page is left once it was hidden for some time, and back as soon as it is seen", () => {
  hide(true);
  vi.advanceTimersByTime(LEFT_AFTER - 1);
  hide(false);
  hide(true);
  vi.advanceTimersByTime(LEFT_AFTER - 1);
  expect(presence.left.value).toBe(false);
  vi.advanceTimersByTime(1);
  expect(presence.left.value).toBe(true);
  hide(false);
  expect(presence.left.value).toBe(false);
});

test("so is a viewer that was scrolled out of the window", () => {
  presence.away = true;
  expect(presence.visible.value).toBe(false);
  vi.advanceTimersByTime(LEFT_AFTER);
  expect(presence.left.value).toBe(true);
  presence.away = false;
  expect([presence.visible.value, presence.left.value]).toEqual([true, false]);
});

test.each([
  ["frozen", () => page.dispatchEvent(new Event("freeze")), () => page.dispatchEvent(new Event("resume"))],
  [
    "kept for the back button",
    () => window.dispatchEvent(new Event("pagehide")),
    () => window.dispatchEvent(new Event("pageshow")),
  ],
])("a page that is %s is left at once", (_, leave, comeBack) => {
  leave();
  expect(presence.left.value).toBe(true);
  comeBack();
  expect(presence.left.value).toBe(false);
});

test("the browser's report about the network is followed", () => {
  for (const onLine of [false, true]) {
    vi.stubGlobal("navigator", { onLine });
    window.dispatchEvent(new Event(onLine ? "online" : "offline"));
    expect(presence.offline.value).toBe(!onLine);
  }
});

test("a hidden page does nothing at intervals", () => {
  const task = vi.fn();
  const stop = presence.every(100, task);
  vi.advanceTimersByTime(250);
  hide(true);
  vi.advanceTimersByTime(1000);
  expect(task).toHaveBeenCalledTimes(2);
  hide(false);
  vi.advanceTimersByTime(100);
  stop();
  vi.advanceTimersByTime(1000);
  expect(task).toHaveBeenCalledTimes(3);
});

test("waiting for a visible page ends when it is shown, or nobody waits any more", async () => {
  const stop = new AbortController();
  await presence.untilVisible(stop.signal);
  hide(true);
  let shown = false;
  const waiting = presence.untilVisible(stop.signal).then(() => {
    shown = true;
  });
  await Promise.resolve();
  expect(shown).toBe(false);
  hide(false);
  await waiting;
  hide(true);
  const aborted = presence.untilVisible(stop.signal);
  stop.abort(new Error("closed"));
  await expect(aborted).rejects.toThrow("closed");
});
