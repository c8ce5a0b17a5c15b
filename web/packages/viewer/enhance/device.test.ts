import { afterEach, describe, expect, it, vi } from "vitest";
import { openDevice } from "./device";

afterEach(() => void vi.unstubAllGlobals());

function withAdapters(...adapters: readonly (object | null)[]): void {
  const requestAdapter = vi.fn();
  for (const adapter of adapters) requestAdapter.mockResolvedValueOnce(adapter);
  vi.stubGlobal("navigator", { gpu: { requestAdapter } });
}

describe("openDevice", () => {
  const device = {};
  const adapter = { features: new Set(["shader-f16"]), requestDevice: vi.fn(async () => device) };

  it("opens a device with the optional features that it has", async () => {
    withAdapters(adapter);
    expect(await openDevice()).toBe(device);
    expect(adapter.requestDevice).toHaveBeenCalledWith({ requiredFeatures: ["shader-f16"] });
  });

  it("asks again if the browser has not found the graphics processor yet", async () => {
    withAdapters(null, adapter);
    expect(await openDevice()).toBe(device);
  });

  it("gives one sentence without a graphics processor", async () => {
    withAdapters(null, null);
    await expect(openDevice()).rejects.toThrow("WebGPU found no graphics processor.");
  });
});
