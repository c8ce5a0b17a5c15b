import { beforeEach, expect, test, vi } from "vitest";
import { fetchMovement, listMovements } from "./stored-movements";

beforeEach(() => {
  vi.stubGlobal("location", { href: "http://lab:8080/" });
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
  let asked = answer(() => Response.json({ movements: [WALK] }));
  expect(await listMovements("http://lab:8091/")).toEqual([WALK]);
  expect(asked).toEqual(["http://lab:8091/movements"]);
  asked = answer(() => new Response("t_ms,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n40,0,0,1,0,0,0,1\n"));
  const name = "a/../b c";
  expect(await fetchMovement("http://lab:8091", name)).toMatchObject({
    name,
    origin: "store",
    trace: { duration: 40 },
  });
  expect(asked).toEqual(["http://lab:8091/movements/a%2F..%2Fb%20c"]);
});

test("an unreadable stored movement is reported by its name", async () => {
  answer(() => new Response("<html>"));
  await expect(fetchMovement("http://lab", "walk")).rejects.toThrow(/^walk has no column “t_ms”/);
});

test.each([
  ["is away", () => Promise.reject(new TypeError("Failed to fetch"))],
  ["lists something else", () => Response.json({ movements: [{ name: 7 }] })],
])("a store that %s is named", async (_, make) => {
  answer(make);
  await expect(listMovements("http://lab:1")).rejects.toThrow("The store at http://lab:1 is not responding");
});
