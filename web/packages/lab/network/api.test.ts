import { afterEach, expect, test, vi } from "vitest";
import { shaperObstacle } from "#client/http/problem";
import { ShaperApi, ShaperError } from "./api";

afterEach(() => {
  vi.unstubAllGlobals();
});

function answer(make: () => Response | Promise<Response>): string[] {
  const asked: string[] = [];
  vi.stubGlobal("fetch", async (url: string, { method = "GET", body = "" }: RequestInit) => {
    asked.push(`${method} ${url} ${body}`.trim());
    return make();
  });
  return asked;
}

test("asks where the shaper answers, whatever a trace's name", async () => {
  const asked = answer(() => Response.json({}));
  const api = new ShaperApi("http://lab:8090/");
  await api.traces();
  await api.trace("a/b c");
  await api.start({ trace: "bus", loop: false });
  await api.pause();
  await api.resume();
  await api.stop();
  await api.loop(true);
  await api.link({ down_kbps: 1, up_kbps: 2 });
  expect(asked).toEqual([
    "GET http://lab:8090/traces",
    "GET http://lab:8090/traces/a%2Fb%20c",
    'POST http://lab:8090/start {"trace":"bus","loop":false}',
    "POST http://lab:8090/pause {}",
    "POST http://lab:8090/resume {}",
    "POST http://lab:8090/stop {}",
    'POST http://lab:8090/loop {"loop":true}',
    'POST http://lab:8090/link {"down_kbps":1,"up_kbps":2}',
  ]);
});

test("a refusal is the shaper's own sentence", async () => {
  const problem = { type: "tigas:nothing-plays", title: "", status: 409, detail: "No trace is playing." };
  answer(() => Response.json(problem, { status: 409 }));
  await expect(new ShaperApi("http://lab").pause()).rejects.toThrow(new ShaperError("No trace is playing."));
});

test.each([
  ["is away", () => Promise.reject(new TypeError("Failed to fetch"))],
  ["answers with a page", () => new Response("<html>")],
])("a shaper that %s is named", async (_, make) => {
  answer(make);
  await expect(new ShaperApi("http://lab:1/").traces()).rejects.toThrow("The shaper at http://lab:1 does not answer");
});

test.each([
  ["http://lab:8090", "http://lab:8080/", null],
  ["https://lab:8090", "https://lab:8443/", null],
  ["http://localhost:8090", "https://localhost:8443/", null],
  ["http://127.0.0.1:8090", "https://localhost:8443/", null],
  ["http://lab:8090", "https://lab:8443/", /secure page/],
  ["http://localhost.example:8090", "https://lab:8443/", /secure page/],
  ["lab 8090", "http://lab:8080/", /not a URL: lab 8090/],
])("what keeps a page from %s", (base, page, sentence) => {
  if (sentence) expect(shaperObstacle(base, page)).toMatch(sentence);
  else expect(shaperObstacle(base, page)).toBeNull();
});
