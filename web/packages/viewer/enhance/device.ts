/** The page's GPU device, requested when the first model is switched on. */
import { EnhancementError } from "./model/enhancer";

/** Optional features; models look for them in `device.features`. */
const WELCOME: readonly GPUFeatureName[] = ["timestamp-query", "shader-f16"];

/** Why this page has no WebGPU; null if it may have. */
export function webgpuProblem(): string | null {
  if (navigator.gpu !== undefined) return null;
  return globalThis.isSecureContext
    ? "This browser has no WebGPU."
    : "WebGPU needs a secure page: open this page over HTTPS, or on localhost.";
}

/** Opens the device. Rejects with an EnhancementError. */
export async function openDevice(): Promise<GPUDevice> {
  const problem = webgpuProblem();
  if (problem !== null) throw new EnhancementError(problem);
  const requested = () => navigator.gpu.requestAdapter({ powerPreference: "high-performance" });
  // Headless Chromium answers the first request with null while it looks for the graphics processor.
  const adapter = (await requested()) ?? (await requested());
  if (adapter === null) throw new EnhancementError("WebGPU found no graphics processor.");
  try {
    return await adapter.requestDevice({
      requiredFeatures: WELCOME.filter((feature) => adapter.features.has(feature)),
    });
  } catch {
    throw new EnhancementError("The graphics processor is not available right now.");
  }
}
