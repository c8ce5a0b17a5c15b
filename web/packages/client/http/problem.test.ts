import { expect, test, vi } from "vitest";
import { shaperObstacle, storeUnreachable } from "./obstacles";
import { ApiError, ask } from "./problem";

const asked = (make: (init: RequestInit) => Response | Promise<Response>, signal?: AbortSignal, timeout = 1000) => {
  vi.stubGlobal("fetch", async (_: string, init: RequestInit) => make(init));
  return ask(
    "http://lab/x",
    (answer) => answer.json(),
    () => "It is away.",
    { signal, timeout },
  );
};
const unanswered = ({ signal }: RequestInit) =>
  new Promise<Response>((_, reject) => signal?.addEventListener("abort", () => reject(signal.reason)));

test("an answer is read", async () => {
  await expect(asked(() => Response.json({ a: 1 }))).resolves.toEqual({ a: 1 });
});

test.each([
  ["in its own words", { type: "tigas:x", title: "", detail: "The disk is full." }, "The disk is full.", "tigas:x"],
  ["of something in between", { error: 1 }, "The server answered with status 507.", "about:blank"],
])("a refusal %s is told", async (_, body, sentence, type) => {
  const refused = asked(() => Response.json(body, { status: 507 }));
  await expect(refused).rejects.toThrow(new ApiError(sentence, false, type));
});

test.each([
  ["does not answer", () => Promise.reject(new TypeError("Failed to fetch"))],
  ["answers with a page", () => new Response("<html>")],
  ["takes too long", unanswered],
])("a service that %s is unreachable", async (_, make) => {
  await expect(asked(make, undefined, 1)).rejects.toThrow(new ApiError("It is away.", true));
});

test("aborting rejects with the reason and not with a sentence", async () => {
  const abort = new AbortController();
  const answer = asked(unanswered, abort.signal);
  abort.abort(new Error("left the page"));
  await expect(answer).rejects.toThrow("left the page");
});

test.each([
  ["http://lab:8090", "http://lab:8080/", null],
  ["https://lab:8090", "https://lab:8443/", null],
  ["http://localhost:8090", "https://localhost:8443/", null],
  ["http://127.0.0.1:8090", "https://localhost:8443/", null],
  ["http://lab:8090", "https://lab:8443/", /secure page/],
  ["http://localhost.example:8090", "https://lab:8443/", /secure page/],
  ["lab 8090", "http://lab:8080/", /not a URL: lab 8090/],
])("between the shaper at %s and the page at %s there is %s", (base, page, sentence) => {
  if (sentence) expect(shaperObstacle(base, page)).toMatch(sentence);
  else expect(shaperObstacle(base, page)).toBeNull();
});

test.each([
  ["http://lab:8091", "https://lab:8443/", /^Browsers do not let a secure page use a store over plain HTTP/],
  ["http://localhost:8091", "https://localhost:8443/", /^The store at http:\/\/localhost:8091 is not responding/],
  ["lab 8091", "https://lab:8443/", /^The store at lab 8091 is not responding/],
])("a store at %s that the page at %s does not reach is said", (base, page, sentence) => {
  expect(storeUnreachable(base, page)).toMatch(sentence);
});
