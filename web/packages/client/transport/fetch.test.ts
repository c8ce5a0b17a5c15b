import { expect, test, vi } from "vitest";
import { FetchTransport } from "./fetch";

const REQUEST = { scene: "s", seq: 3, fx: 1, fy: 1, cx: 1, cy: 1, width: 2, height: 2 };
const never = new AbortController().signal;

function answer(make: (init: RequestInit) => Promise<Response> | Response): FetchTransport {
  vi.stubGlobal("fetch", async (_: string, init: RequestInit) => make(init));
  return new FetchTransport(() => 0);
}

test("posts the request and reads the frame", async () => {
  let body = "";
  const subject = answer((init) => {
    body = String(init.body);
    return new Response(new Uint8Array(12), { headers: { "Content-Type": "image/jpeg", "Tigas-Frame": "seq=3" } });
  });
  const { header, image, arrival } = await subject.request(REQUEST, never);
  expect(JSON.parse(body)).toEqual(REQUEST);
  expect(header.seq).toBe(3);
  expect(image.size).toBe(12);
  expect(image.type).toBe("image/jpeg");
  expect(arrival.bytes).toBe(12);
});

test("names itself, and keeps its name when it connects anew", async () => {
  const names = new Set<string | null>();
  for (const _ of [1, 2]) {
    const subject = answer((init) => {
      names.add(new Headers(init.headers).get("Tigas-Viewer"));
      return new Response(null, { headers: { "Tigas-Frame": "seq=3" } });
    });
    await subject.request(REQUEST, never);
  }
  expect([...names]).toEqual([expect.stringMatching(/^[\d-]{8,64}$/)]);
});

test("a problem is a refusal, and the server is still there", async () => {
  const problem = { type: "tigas:superseded", title: "", status: 409, detail: "Newer requests took its place." };
  const subject = answer(() => Response.json(problem, { status: 409 }));
  await expect(subject.request(REQUEST, never)).rejects.toMatchObject({ problem });
  expect(await Promise.race([subject.lost, Promise.resolve("there")])).toBe("there");
});

test("a full server takes this viewer no more: the connection has to be made anew", async () => {
  const problem = { type: "tigas:full", title: "", status: 503, detail: "The server is full." };
  const subject = answer(() => Response.json(problem, { status: 503 }));
  await expect(subject.request(REQUEST, never)).rejects.toMatchObject({ problem });
  expect(await subject.lost).toBe("The server is full.");
});

test("an error page of something in between becomes a sentence", async () => {
  const subject = answer(() => new Response("<h1>Bad gateway</h1>", { status: 502 }));
  await expect(subject.request(REQUEST, never)).rejects.toThrow("The server answered with status 502.");
});

test("a network failure means that the server is lost", async () => {
  const subject = answer(() => Promise.reject(new TypeError("Failed to fetch")));
  await expect(subject.request(REQUEST, never)).rejects.toThrow();
  expect(await subject.lost).toBe("The server is not responding.");
});

test("a cancelled request is not a lost server", async () => {
  const abort = new AbortController();
  const subject = answer(
    ({ signal }) => new Promise((_, reject) => signal?.addEventListener("abort", () => reject(signal.reason))),
  );
  const reply = subject.request(REQUEST, abort.signal);
  abort.abort(new Error("overtaken"));
  await expect(reply).rejects.toThrow("overtaken");
  expect(await Promise.race([subject.lost, Promise.resolve("there")])).toBe("there");
});

test("closing ends what is in flight", async () => {
  const subject = answer(
    ({ signal }) => new Promise((_, reject) => signal?.addEventListener("abort", () => reject(signal.reason))),
  );
  const reply = subject.request(REQUEST, never);
  subject.close();
  await expect(reply).rejects.toThrow("closed");
});
