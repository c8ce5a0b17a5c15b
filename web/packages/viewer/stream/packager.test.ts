import { beforeEach, describe, expect, test, vi } from "vitest";
import type { SessionRequest } from "#client/wire/dash";
import { endSession, openSession, openWebRtc, repeatedShare } from "./packager";

const REQUEST = { scene: "courtyard" } as SessionRequest;
const SIGNAL = new AbortController().signal;

beforeEach(() => {
  vi.stubGlobal("location", { href: "http://page/" });
});

function answer(response: () => Response | Promise<Response>) {
  const asked = vi.fn(async (_url: string, _init: RequestInit) => response());
  vi.stubGlobal("fetch", asked);
  return asked;
}

test.each([
  [400, false],
  [404, false],
  [502, true],
  [503, true],
])("a refusal with status %i is told in its own words; another try may help: %s", async (status, unreachable) => {
  answer(() => Response.json({ type: "tigas:x", title: "X", status, detail: "A sentence." }, { status }));
  await expect(openSession("http://packager", REQUEST, SIGNAL)).rejects.toMatchObject({
    message: "A sentence.",
    unreachable,
  });
});

test.each([
  ["DASH", openSession],
  ["WebRTC", openWebRtc],
])("a packager of %s streams that is away is named as that", async (name, open) => {
  answer(() => Promise.reject(new TypeError("Failed to fetch")));
  await expect(open("http://packager", REQUEST as never, SIGNAL)).rejects.toMatchObject({
    message: `The ${name} streaming server is not responding.`,
    unreachable: true,
  });
});

test("a secure page is told why it cannot have the stream, and that another try will not help", async () => {
  vi.stubGlobal("location", { href: "https://page/" });
  const asked = answer(() => Response.json({}));
  await expect(openSession("http://packager", REQUEST, SIGNAL)).rejects.toMatchObject({
    message: expect.stringContaining("open this page over http://"),
    unreachable: false,
  });
  expect(asked).not.toHaveBeenCalled();
  await openSession("https://packager", REQUEST, SIGNAL);
  await openSession("http://localhost:8081", REQUEST, SIGNAL);
  expect(asked).toHaveBeenCalledTimes(2);
});

test("a stream that nobody wants any more when its name is heard is ended", async () => {
  const asked = answer(() => Response.json({ id: "a1" }));
  const leaving = new AbortController();
  const opening = openSession("http://packager", REQUEST, leaving.signal);
  leaving.abort();
  await expect(opening).rejects.toMatchObject({ name: "AbortError" });
  expect(asked.mock.lastCall).toMatchObject(["http://packager/sessions/a1", { method: "DELETE" }]);
  await expect(openSession("http://packager", REQUEST, leaving.signal)).rejects.toMatchObject({ name: "AbortError" });
  expect(asked).toHaveBeenCalledTimes(2);
});

test("a session is ended even while the page goes away, and nobody minds if that fails", async () => {
  const asked = answer(() => Promise.reject(new TypeError("Failed to fetch")));
  await endSession("http://packager", { id: "a1" });
  expect(asked.mock.calls[0]).toMatchObject(["http://packager/sessions/a1", { method: "DELETE", keepalive: true }]);
});

describe("repeats", () => {
  const counts = (frames: number, repeated: number, dropped = 0, id = "a") => ({ id, frames, repeated, dropped });

  test.each([
    ["frames that all show something new", counts(10, 4), counts(70, 4), 0],
    ["every other frame repeated", counts(10, 4), counts(70, 34), 0.5],
    ["frames that were skipped", counts(0, 0), counts(30, 0, 30), 0.5],
  ])("%s", (_, before, after, share) => {
    expect(repeatedShare(before, after)).toBe(share);
  });

  test("of another stream, of none, or of no time nothing is told", () => {
    expect(repeatedShare(null, counts(9, 9))).toBeNull();
    expect(repeatedShare(counts(9, 9), null)).toBeNull();
    expect(repeatedShare(counts(9, 9), counts(9, 9))).toBeNull();
    expect(repeatedShare(counts(9, 9), counts(90, 9, 0, "b"))).toBeNull();
  });
});
