import { afterEach, expect, test, vi } from "vitest";
import { MovementError } from "./movement";
import { fetchMovement, listMovements } from "./movements";

afterEach(() => {
  vi.unstubAllGlobals();
});

function answer(make: () => Response | Promise<Response>): string[] {
  const asked: string[] = [];
  vi.stubGlobal("fetch", async (url: string) => {
    asked.push(url);
    return make();
  });
  return asked;
}

const WALK = { name: "walk", duration_ms: 20_000, anchor: "start", description: "A walk" };

test("asks where the store answers, whatever a movement's name", async () => {
  const asked = answer(() => Response.json({ movements: [WALK] }));
  expect(await listMovements("http://lab:8091/")).toEqual([WALK]);
  await fetchMovement("http://lab:8091", "a/../b c");
  expect(asked).toEqual(["http://lab:8091/movements", "http://lab:8091/movements/a%2F..%2Fb%20c"]);
});

test("a refusal is the store's own sentence", async () => {
  answer(() =>
    Response.json({ type: "tigas:x", title: "", status: 404, detail: "No such movement." }, { status: 404 }),
  );
  await expect(fetchMovement("http://lab", "gone")).rejects.toThrow(new MovementError("No such movement."));
});

test.each([
  ["is away", () => Promise.reject(new TypeError("Failed to fetch"))],
  ["answers with a page", () => new Response("<html>")],
  ["lists something else", () => Response.json({ movements: [{ name: 7 }] })],
])("a store that %s is named", async (_, make) => {
  answer(make);
  await expect(listMovements("http://lab:1")).rejects.toThrow("The store at http://lab:1 does not answer");
});
