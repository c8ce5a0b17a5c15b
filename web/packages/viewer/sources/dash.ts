/** The mode `dash`: a stream over DASH, by preset. */
import { PRESETS } from "../dash/presets";
import { streamed } from "./streamed";

export const DASH = streamed({
  kind: "dash",
  variants: PRESETS.map((preset) => ({
    name: `dash-${preset}`,
    title: `DASH, ${preset}`,
    settings: { dashPreset: preset },
  })),
  settings: ["dashPreset", "dashFrameRate", "dashRepresentation", "dashTransport", "dashCustom"],
  load: async () => (await import("./dash-source")).openDash,
});
