import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import { type DownloadOptions, download } from "./download";

const FILE = Uint8Array.from({ length: 1000 }, (_, i) => i % 251);

type Answer = (request: Headers, signal: AbortSignal) => Response | Error | Promise<never>;

/** Pauses take no time other than one turn of the event loop. */
beforeEach(() => {
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] }).setTimerTickMode("nextTimerAsync");
});
afterEach(() => void vi.useRealTimers());

/** A server that answers one request after another, with a log of its requests. */
function server(...answers: Answer[]) {
  const asked: Headers[] = [];
  vi.stubGlobal("fetch", async (_: string, { headers, signal }: { headers?: HeadersInit; signal: AbortSignal }) => {
    asked.push(new Headers(headers));
    const answer = answers[asked.length - 1]?.(asked.at(-1) as Headers, signal);
    if (answer === undefined) throw new Error("there was one request more than expected");
    if (answer instanceof Error) throw answer;
    return answer;
  });
  return asked;
}

/** An answer with the file from a byte on; `until` cuts it off. */
function part({ from = 0, until = FILE.length, etag = '"one"', file = FILE } = {}): Response {
  const rest = file.slice(from, until);
  const body = new ReadableStream({
    start: (controller) => {
      if (rest.length > 0) controller.enqueue(rest.slice(0, 100));
      if (rest.length > 100) controller.enqueue(rest.slice(100));
    },
    pull: (controller) => (until < file.length ? controller.error(new TypeError("network error")) : controller.close()),
  });
  const range = { "content-range": `bytes ${from}-${file.length - 1}/${file.length}` };
  const headers = { etag, "content-length": String(file.length - from), ...(from > 0 && range) };
  return new Response(body, { status: from > 0 ? 206 : 200, headers });
}

/** An answer with the file's beginning, which then stalls. */
const silent: Answer = (_, signal) => {
  const body = new ReadableStream({
    start: (controller) => {
      controller.enqueue(FILE.slice(0, 10));
      signal.addEventListener("abort", () => controller.error(signal.reason));
    },
  });
  return new Response(body, { headers: { "content-length": "1000", etag: '"one"' } });
};

/** No answer at all. */
const hangs: Answer = (_, signal) =>
  new Promise((_, reject) => signal.addEventListener("abort", () => reject(signal.reason)));

const fetched = (answers: Answer[], options: Partial<DownloadOptions> = {}) => {
  const asked = server(...answers);
  const onCut = vi.fn();
  const received: number[] = [];
  const file = download({
    url: () => "scenes/garden/download/compressed",
    signal: new AbortController().signal,
    onBytes: (_, count) => received.push(count),
    onCut,
    ...options,
  });
  return { file, asked, onCut, received };
};

test("a file comes in parts, and is whole in the end", async () => {
  const { file, received, asked } = fetched([() => part()]);
  expect(await file).toEqual(FILE);
  expect([received[0], received.at(-1)]).toEqual([100, 1000]);
  expect(asked[0]?.get("range")).toBeNull();
});

test("an answer that is no file is not asked for again", async () => {
  const broken = () => {
    throw new ApiError("The downloaded scene is not a PLY file.", false);
  };
  const { file, asked } = fetched([() => part()], { onBytes: broken });
  await expect(file).rejects.toThrow("not a PLY file");
  expect(asked).toHaveLength(1);
});

test("a request without any answer is made again", async () => {
  const { file, onCut } = fetched([hangs, () => part()]);
  expect(await file).toEqual(FILE);
  expect(onCut).toHaveBeenCalledWith("The server is not responding.");
});

test("an interrupted download resumes where it ended, if the file is the same", async () => {
  const { file, asked, onCut } = fetched([
    () => part({ until: 300 }),
    () => new TypeError("Failed to fetch"),
    () => part({ from: 300, until: 700 }),
    () => part({ from: 700 }),
  ]);
  expect(await file).toEqual(FILE);
  expect(asked.map((one) => one.get("range"))).toEqual([null, "bytes=300-", "bytes=300-", "bytes=700-"]);
  expect(asked[3]?.get("if-range")).toBe('"one"');
  expect(onCut.mock.calls.map(([message]) => message)).toEqual([
    "The download was interrupted.",
    "The server is not responding.",
    "The download was interrupted.",
  ]);
});

test("a file that has changed meanwhile begins anew", async () => {
  const other = FILE.map((byte) => byte ^ 1);
  const { file, received } = fetched([() => part({ until: 300 }), () => part({ etag: '"two"', file: other })]);
  expect(await file).toEqual(other);
  expect(received.slice(-2)).toEqual([100, 1000]);
});

test("a full server is asked again; after a refusal it is not", async () => {
  const problem = (status: number, detail: string) => () =>
    Response.json({ type: "about:blank", title: "", status, detail }, { status });
  const { file, onCut } = fetched([problem(503, "Too many scenes are being downloaded."), () => part()]);
  expect(await file).toEqual(FILE);
  expect(onCut).toHaveBeenCalledWith("Too many scenes are being downloaded.");
  const refused = fetched([problem(404, "There is no scene garden.")]).file;
  await expect(refused).rejects.toEqual(new ApiError("There is no scene garden.", false));
});

test("a server that falls silent is asked again for the rest", async () => {
  const { file, asked } = fetched([silent, () => part({ from: 10 })]);
  expect(await file).toEqual(FILE);
  expect(asked[1]?.get("range")).toBe("bytes=10-");
});

test("a length that is not told, or too little memory for it, ends with a sentence", async () => {
  const untold = fetched([() => new Response("abc")]).file;
  await expect(untold).rejects.toThrow("The server did not report the size of the scene.");
  const huge = fetched([() => new Response("abc", { headers: { "content-length": String(2 ** 52) } })]).file;
  await expect(huge).rejects.toThrow("This browser does not have enough memory for this scene.");
});

test("leaving ends the download", async () => {
  const visit = new AbortController();
  let link: AbortSignal | undefined;
  const endless: Answer = (request, signal) => {
    link = signal;
    return silent(request, signal);
  };
  const { file } = fetched([endless], { signal: visit.signal, onBytes: () => visit.abort() });
  await expect(file).rejects.toThrow();
  expect(link?.aborted).toBe(true);
});
