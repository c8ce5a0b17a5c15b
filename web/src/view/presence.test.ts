import { beforeEach, expect, test } from "vitest";
import { Presence, visible } from "./presence";

let page: Document & { hidden: boolean };

beforeEach(() => {
  page = Object.assign(new EventTarget(), { hidden: false }) as unknown as Document & { hidden: boolean };
});

function hide(hidden: boolean): void {
  page.hidden = hidden;
  page.dispatchEvent(new Event("visibilitychange"));
}

test("frames that are late, but seen, are no gap: a slow page is to be measured", () => {
  const presence = new Presence(page);
  expect([0, 16, 900].map((at) => presence.gap(at))).toEqual([0, 0, 0]);
});

test("the time in which the page was hidden is a gap, however short it was", () => {
  const presence = new Presence(page);
  presence.gap(0);
  hide(true);
  hide(false);
  expect([300, 316].map((at) => presence.gap(at))).toEqual([300, 0]);
});

test("so is that in which a machine slept, of which browsers tell nothing", () => {
  const presence = new Presence(page);
  expect([0, 30_000, 30_016].map((at) => presence.gap(at))).toEqual([0, 30_000, 0]);
});

test("waiting for a visible page ends when it is shown, or nobody waits any more", async () => {
  const stop = new AbortController();
  await visible(stop.signal, page);
  hide(true);
  let shown = false;
  const waiting = visible(stop.signal, page).then(() => {
    shown = true;
  });
  await Promise.resolve();
  expect(shown).toBe(false);
  hide(false);
  await waiting;
  hide(true);
  const aborted = visible(stop.signal, page);
  stop.abort(new Error("closed"));
  await expect(aborted).rejects.toThrow("closed");
});
