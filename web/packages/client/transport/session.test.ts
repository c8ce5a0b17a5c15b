import { afterEach, expect, test, vi } from "vitest";
import { FakeSession } from "#fakes/web-transport";
import { openSession } from "./session";

const OPTIONS = { url: "https://localhost:4433/render", certificateSha256: "AQID", timeout: 3000 };
const never = new AbortController().signal;

afterEach(() => {
  vi.restoreAllMocks();
});

/** A timeout that the test triggers. */
function controlledTimeout(): AbortController {
  const controller = new AbortController();
  vi.spyOn(AbortSignal, "timeout").mockReturnValue(controller.signal);
  return controller;
}

test("trusts exactly the certificate that the server named", async () => {
  const fake = new FakeSession();
  const open = vi.fn((_url: string, _options: WebTransportOptions) => fake.session);
  fake.opened.resolve();
  expect(await openSession(OPTIONS, never, open)).toBe(fake.session);
  expect(open.mock.calls[0]?.[0]).toBe(OPTIONS.url);
  const [hash] = open.mock.calls[0]?.[1].serverCertificateHashes ?? [];
  expect(hash?.algorithm).toBe("sha-256");
  expect(hash?.value).toEqual(Uint8Array.of(1, 2, 3));
});

test("without a hash the browser checks the certificate itself", async () => {
  const fake = new FakeSession();
  const open = vi.fn((_url: string, _options: WebTransportOptions) => fake.session);
  fake.opened.resolve();
  await openSession({ ...OPTIONS, certificateSha256: null }, never, open);
  expect(open.mock.calls[0]?.[1]).toEqual({});
});

test("a network that swallows QUIC is given up in time", async () => {
  const timeout = controlledTimeout();
  const fake = new FakeSession();
  const opening = openSession(OPTIONS, never, () => fake.session);
  timeout.abort(new DOMException("", "TimeoutError"));
  await expect(opening).rejects.toThrow("QUIC did not respond in time");
  expect(fake.closes).toBe(1);
});

test("a refused session says so", async () => {
  const fake = new FakeSession();
  const opening = openSession(OPTIONS, never, () => fake.session);
  fake.opened.reject(new Error("Opening handshake failed."));
  fake.ended.reject(new Error("Opening handshake failed."));
  await expect(opening).rejects.toThrow("QUIC could not connect");
});

test("aborting closes what was being opened", async () => {
  const abort = new AbortController();
  const fake = new FakeSession();
  const opening = openSession(OPTIONS, abort.signal, () => fake.session);
  abort.abort(new Error("left the page"));
  await expect(opening).rejects.toThrow("left the page");
  expect(fake.closes).toBe(1);
});
