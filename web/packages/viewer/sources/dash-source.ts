/** A stream over DASH as a source. */
import { overDash } from "../dash/dash-views";
import { planFor } from "../dash/presets";
import { openStreamed } from "./streamed-source";

export const openDash = openStreamed({
  kind: "dash",
  planOf: planFor,
  adaptive: ({ adaptive }) => adaptive,
  open: overDash,
});
