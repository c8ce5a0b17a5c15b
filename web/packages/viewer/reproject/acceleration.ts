/** Whether this tab warps pictures: not after it proved too slow, unless forced. Remembered across reloads. */
import { effect, signal } from "@preact/signals";

const KEY = "tigas.turning";
type Turning = "slow" | "forced" | null;

export const turning = signal<Turning>(remembered());

effect(() => {
  const { value } = turning;
  try {
    if (value === null) sessionStorage.removeItem(KEY);
    else sessionStorage.setItem(KEY, value);
  } catch {
    // no storage: remembered as long as the page lives
  }
});

/**
 * Whether the browser renders in software, judging by its renderer's name: not every browser counts that as a
 * performance caveat.
 */
export function drawsInSoftware(gl: WebGL2RenderingContext): boolean {
  const named = gl.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER;
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(String(gl.getParameter(named)));
}

function remembered(): Turning {
  try {
    const value = sessionStorage.getItem(KEY);
    return value === "slow" || value === "forced" ? value : null;
  } catch {
    return null;
  }
}
