import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { StoreApi } from "./store-api";

const store = new StoreApi("http://lab:8091/");

let asked: { url: string; body: unknown }[];
let limits: number[];

beforeEach(() => {
  asked = [];
  limits = [];
  vi.stubGlobal("location", { href: "http://lab:8080/" });
  vi.spyOn(AbortSignal, "timeout").mockImplementation((limit) => {
    limits.push(limit);
    return new AbortController().signal;
  });
});

afterEach(() => {
  vi.restoreAllMocks();
});

function answer(make: () => Response | Promise<Response>): void {
  vi.stubGlobal("fetch", async (url: string, { body }: RequestInit) => {
    asked.push({ url, body: typeof body === "string" ? JSON.parse(body) : null });
    return make();
  });
}

test("an experiment is begun with its file", async () => {
  answer(() => Response.json({ id: "two-1" }, { status: 201 }));
  expect(await store.create({ file: "name = 1" })).toBe("two-1");
  expect(asked).toEqual([{ url: "http://lab:8091/experiments", body: { file: "name = 1" } }]);
});

test("a run is given back even while the page unloads, and a capture has its number", async () => {
  const requests: [string, RequestInit][] = [];
  vi.stubGlobal("fetch", async (url: string, request: RequestInit) => {
    requests.push([url, request]);
    return new Response();
  });
  store.release("a/b", "page");
  await store.addCapture("a", "run", 7, new Blob());
  expect(requests).toMatchObject([
    ["http://lab:8091/experiments/a%2Fb/pages/page", { method: "DELETE", keepalive: true }],
    ["http://lab:8091/experiments/a/runs/run/captures/0007.png", { method: "PUT" }],
  ]);
});

test("an experiment is asked for and offered as a file by its id, whatever that is", async () => {
  answer(() => Response.json({ id: "a/b" }));
  await store.get("a/b");
  expect(asked[0]?.url).toBe("http://lab:8091/experiments/a%2Fb");
  expect(store.zipUrl("a/b")).toBe("http://lab:8091/experiments/a%2Fb/zip");
});

test("a large run may take long", async () => {
  answer(() => Response.json({}));
  await store.add("two-1", "run", { problem: "x".repeat(12_500_000) });
  await store.add("two-1", "run", { problem: "x" });
  const [large = 0, small = 0] = limits;
  expect(large - small).toBeGreaterThan(99_000);
});

test.each([
  ["is away", () => Promise.reject(new TypeError("Failed to fetch"))],
  ["is something else", () => new Response("<html>")],
])("a store that %s is named", async (_, make) => {
  answer(make);
  await expect(store.list()).rejects.toThrow("The store at http://lab:8091 is not responding");
});
