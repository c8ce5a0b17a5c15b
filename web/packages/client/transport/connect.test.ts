import { beforeEach, expect, test, vi } from "vitest";
import { FakeTransport } from "#fakes/transport";
import { connect, type FrameBackend, type TransportChoice } from "./connect";
import type { DecodedImage } from "./transport";

const CONFIG = { webtransport_url: "https://localhost:4433/render", certificate_sha256: "AQID" };
const VIEW = { scene: "s", fx: 1, fy: 1, cx: 1, cy: 1, width: 2, height: 2 };
const never = new AbortController().signal;
const PICTURE = { bitmap: {}, depth: null } as DecodedImage;
const backend = (open: FrameBackend["open"]): FrameBackend => ({ open, decode: async () => PICTURE });
const opens = backend(async (kind) => new FakeTransport(() => 0, { kind }));
const fails = backend(() => Promise.reject(new Error("QUIC did not respond in time")));

beforeEach(() => {
  vi.stubGlobal("isSecureContext", true);
  vi.stubGlobal("WebTransport", class {});
});
test.each<[TransportChoice, string]>([
  ["auto", "webtransport-streams"],
  ["webtransport-streams", "webtransport-streams"],
  ["webtransport-datagrams", "webtransport-datagrams"],
  ["fetch", "fetch"],
])("%s gives %s where everything works", async (choice, kind) => {
  const { transport, fallback } = await connect(CONFIG, choice, never, () => 0, opens);
  expect(transport.kind).toBe(kind);
  expect(fallback).toBeNull();
});

test("falls back to fetch, and says why", async () => {
  const { transport, fallback, refused } = await connect(CONFIG, "auto", never, () => 0, fails);
  expect(refused).toBe(true);
  expect(transport.kind).toBe("fetch");
  expect(fallback).toBe("QUIC did not respond in time");
});

test.each([
  ["no secure context", () => vi.stubGlobal("isSecureContext", false), CONFIG, "secure context"],
  ["an old browser", () => vi.stubGlobal("WebTransport", undefined), CONFIG, "no WebTransport"],
  ["QUIC switched off", () => undefined, { ...CONFIG, webtransport_url: null }, "does not offer WebTransport"],
])("%s needs no attempt", async (_, prepare, config, reason) => {
  prepare();
  const open = vi.fn(opens.open);
  const { transport, fallback, refused } = await connect(config, "auto", never, () => 0, backend(open));
  expect(refused ?? false).toBe(false);
  expect(transport.kind).toBe("fetch");
  expect(fallback).toContain(reason);
  expect(open).not.toHaveBeenCalled();
});

test.each([
  ["its own address without a cluster", "http://lab.test:8080/", {}, "render"],
  [
    "the host",
    "http://lab.test:8080/",
    { host: "east", render_url: "http://10.0.0.2:8080" },
    "http://10.0.0.2:8080/render",
  ],
  [
    "the host on this machine",
    "https://lab.test/",
    { host: "a", render_url: "http://[::1]:8080" },
    "http://[::1]:8080/render",
  ],
  [
    "the director, if the page is secure",
    "https://lab.test/",
    { host: "a&b", render_url: "http://10.0.0.2:8080" },
    "render?host=a%26b",
  ],
])("without QUIC frames are asked for at %s", async (_, page, cluster, url) => {
  const fetched = vi.fn(() => Promise.reject(new Error("not now")));
  vi.stubGlobal("fetch", fetched);
  vi.stubGlobal("location", new URL(page));
  const { transport } = await connect({ ...CONFIG, ...cluster }, "fetch", never, () => 0, opens);
  await expect(transport.request({ ...VIEW, seq: 0 }, never)).rejects.toThrow("not now");
  expect(fetched).toHaveBeenCalledWith(url, expect.anything());
});

test("aborting is no reason to fall back", async () => {
  const abort = new AbortController();
  const connecting = connect(
    CONFIG,
    "auto",
    abort.signal,
    () => 0,
    backend((...given) => {
      abort.abort(new Error("left the page"));
      return fails.open(...given);
    }),
  );
  await expect(connecting).rejects.toThrow("left the page");
});

test("pictures received by fetch are decoded as well", async () => {
  vi.stubGlobal("location", new URL("http://lab.test/"));
  vi.stubGlobal(
    "fetch",
    async () => new Response("jpeg", { headers: { "content-type": "image/jpeg", "tigas-seq": "0" } }),
  );
  const { transport } = await connect(CONFIG, "fetch", never, () => 0, opens);
  const reply = await transport.request({ ...VIEW, seq: 0 }, never);
  expect(await reply.picture).toBe(PICTURE);
});
