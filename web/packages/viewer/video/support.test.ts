import { afterEach, expect, test, vi } from "vitest";
import { videoProblem } from "./support";

afterEach(() => vi.unstubAllGlobals());

const decoder = (isConfigSupported: () => Promise<{ supported: boolean }>) =>
  vi.stubGlobal("VideoDecoder", { isConfigSupported });

test.each([
  ["without WebCodecs", () => vi.stubGlobal("isSecureContext", true), "no WebCodecs"],
  ["on an insecure page", () => vi.stubGlobal("isSecureContext", false), "only over HTTPS"],
  ["without H.264", () => decoder(async () => ({ supported: false })), "does not decode H.264"],
  ["with a decoder that cannot be asked", () => decoder(() => Promise.reject(new TypeError("no"))), "H.264"],
])("%s one sentence says so, and names the way out", async (_, set, sentence) => {
  set();
  const problem = await videoProblem();
  expect(problem).toContain(sentence);
  expect(problem).toContain("Choose another mode.");
});

test("where the decoder takes it, there is nothing to say", async () => {
  decoder(async () => ({ supported: true }));
  expect(await videoProblem()).toBeNull();
});
