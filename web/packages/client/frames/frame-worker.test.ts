import { beforeEach, expect, test, vi } from "vitest";
import { FakeTransport, settle } from "#fakes/transport";
import type { CalledWorker } from "../async/worker-calls";
import { type DecodedImage, FrameDropped, RequestProblem } from "../transport/transport";
import { FrameHost } from "./frame-host";
import { FrameWorker } from "./frame-worker";
import type { FromWorker, ToWorker } from "./messages";

const VIEW = { scene: "s", seq: 0, fx: 1, fy: 1, cx: 1, cy: 1, width: 2, height: 2 };
const OPTIONS = { url: "https://lab.test/", certificateSha256: null, timeout: 1 };
const never = new AbortController().signal;

let session: FakeTransport;
let opening: Promise<FakeTransport>;
let decoded: (ImageBitmap & { closed: boolean })[];
let decode: (image: Blob) => Promise<DecodedImage>;
let port: CalledWorker;
let worker: FrameWorker;

/** Both sides, with messages copied like a worker's, apart from pictures. */
beforeEach(() => {
  session = new FakeTransport(() => 0, { kind: "webtransport-streams", maxInFlight: 7 });
  opening = Promise.resolve(session);
  decoded = [];
  decode = async () => {
    const bitmap = { closed: false, close: () => Object.assign(bitmap, { closed: true }) };
    decoded.push(bitmap as never);
    return { bitmap: bitmap as never, depth: null };
  };
  const host = new FrameHost({
    post: (message) => {
      const copied: FromWorker =
        message.kind === "picture"
          ? message
          : structuredClone(
              message.kind === "reply" ? { ...message, reply: { ...message.reply, picture: undefined } } : message,
            );
      port.onmessage?.call(port as Worker, { data: copied } as MessageEvent);
    },
    decode: (image) => decode(image),
    open: () => opening,
  });
  port = {
    onmessage: null,
    onerror: null,
    postMessage: (message: ToWorker) => host.receive(structuredClone(message)),
    terminate: () => undefined,
  };
  worker = new FrameWorker(port);
});

const open = () => worker.open("webtransport-streams", OPTIONS, never);

test("a request gets its reply first, and then its picture", async () => {
  const transport = await open();
  expect(transport).toMatchObject({ kind: "webtransport-streams", maxInFlight: 7, overtaking: true });
  const asked = transport.request(VIEW, never);
  await settle();
  session.requests[0]?.reply({ bytes: 1234 });
  const reply = await asked;
  expect(reply.arrival.bytes).toBe(1234);
  expect((await reply.picture)?.bitmap).toBe(decoded[0]);
});

test("frames of a video are decoded elsewhere", async () => {
  const transport = await open();
  const asked = transport.request({ ...VIEW, video: { bitrate_kbps: 1000 } as never }, never);
  await settle();
  session.requests[0]?.reply();
  expect((await asked).picture).toBeUndefined();
  expect(decoded).toEqual([]);
});

test("aborting stops the request in the worker", async () => {
  const transport = await open();
  const abort = new AbortController();
  const asked = transport.request(VIEW, abort.signal);
  await settle();
  abort.abort(new FrameDropped("overtaken"));
  await expect(asked).rejects.toThrow("overtaken");
  expect(session.requests[0]?.signal.aborted).toBe(true);
});

test("errors keep their class and their reason", async () => {
  const transport = await open();
  const problem = { type: "tigas:full", title: "Full", status: 503, detail: "No room." };
  const failures = [new RequestProblem(problem), new FrameDropped("lost"), new TypeError("broken")];
  for (const [i, failure] of failures.entries()) {
    const asked = transport.request(VIEW, never);
    await settle();
    session.requests[i]?.fail(failure);
    const error = await asked.catch((caught: unknown) => caught);
    expect(error).toMatchObject({ name: failure.name, message: failure.message });
    if (failure instanceof RequestProblem) expect(error).toMatchObject({ problem });
    if (failure instanceof FrameDropped) expect(error).toBeInstanceOf(FrameDropped);
  }
});

test("an image that cannot be decoded fails after its reply", async () => {
  decode = () => Promise.reject(new Error("no image"));
  const transport = await open();
  const asked = transport.request(VIEW, never);
  await settle();
  session.requests[0]?.reply();
  await expect((await asked).picture).rejects.toThrow("no image");
  await expect(worker.decode(new Blob())).rejects.toThrow("no image");
});

test("the end of a session is told with its reason, and later requests fail", async () => {
  const transport = await open();
  session.lose("The server closed the connection.");
  expect(await transport.lost).toBe("The server closed the connection.");
  await expect(transport.request(VIEW, never)).rejects.toThrow("ended");
});

test("a session that opens after its page has given up is closed", async () => {
  let opens: (session: FakeTransport) => void = () => undefined;
  opening = new Promise((resolve) => {
    opens = resolve;
  });
  const abort = new AbortController();
  const opened = worker.open("webtransport-streams", OPTIONS, abort.signal);
  abort.abort(new Error("left"));
  await expect(opened).rejects.toThrow("left");
  opens(session);
  await settle();
  expect(session.closed).toBe(true);
});

test("disposing closes the sessions, fails the calls, and closes pictures that still come", async () => {
  let decodes: (picture: DecodedImage) => void = () => undefined;
  decode = () =>
    new Promise((resolve) => {
      decodes = resolve;
    });
  const transport = await open();
  const picture = worker.decode(new Blob());
  worker.dispose();
  await expect(picture).rejects.toThrow("the viewer was closed");
  expect(session.closed).toBe(true);
  expect(await transport.lost).toContain("closed");
  const close = vi.fn();
  decodes({ bitmap: { close } as never, depth: null });
  await settle();
  expect(close).toHaveBeenCalled();
});

test("a worker that cannot start fails all calls", async () => {
  const decoding = worker.decode(new Blob());
  port.onerror?.call(port as Worker, { message: "Failed to fetch a worker script" } as ErrorEvent);
  await expect(decoding).rejects.toThrow("worker script");
  await expect(open()).rejects.toThrow("worker script");
});
