import { beforeEach, expect, test } from "vitest";
import { frameBytes } from "#fakes/frames";
import { turn } from "#fakes/transport";
import { FakeSession } from "#fakes/web-transport";
import { StreamTransport } from "./streams";

const REQUEST = { scene: "s", seq: 3, fx: 1, fy: 1, cx: 1, cy: 1, width: 2, height: 2 };
const never = new AbortController().signal;
let fake: FakeSession;
let subject: StreamTransport;

beforeEach(() => {
  fake = new FakeSession();
  subject = new StreamTransport(fake.session, () => 0);
});

test("one stream per frame: the request goes out, the frame comes back", async () => {
  const reply = subject.request(REQUEST, never);
  await turn();
  expect(JSON.parse((await fake.streams[0]?.request) ?? "")).toEqual(REQUEST);
  fake.streams[0]?.respond(frameBytes({ status: 200, seq: 3, content_type: "image/jpeg" }, new Uint8Array(9)));
  expect((await reply).header.seq).toBe(3);
  expect((await reply).image.size).toBe(9);
});

test("a cancelled frame stops the server's sending and rejects with the reason", async () => {
  const abort = new AbortController();
  const reply = subject.request(REQUEST, abort.signal);
  await turn();
  abort.abort(new Error("overtaken"));
  await expect(reply).rejects.toThrow("overtaken");
  await fake.streams[0]?.stopped;
});

test("a request that is cancelled before it starts opens no stream", async () => {
  await expect(subject.request(REQUEST, AbortSignal.abort(new Error("no")))).rejects.toThrow("no");
  expect(fake.streams).toHaveLength(0);
});

test("says once that the server is lost, however the session ends", async () => {
  fake.ended.reject(new Error("net::ERR_QUIC_PROTOCOL_ERROR"));
  expect(await subject.lost).toBe("The connection to the server was lost.");
});
