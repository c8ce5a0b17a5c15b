/** How each condition looks in charts and tables: as in reports (`tigas_experiments/report/controllers.py`). Pure. */
import looks from "./looks.json";
import type { PlannedRun } from "./plan";

export interface Look {
  /** A CSS colour. */
  readonly colour: string;
  /** Of its line, as a border's style is called; fixed rungs are of one colour. */
  readonly line: "solid" | "dotted" | "dashed" | "double";
}

const KNOWN = looks.known as Readonly<Record<string, Look>>;
/** A report's text: here the page's, which is light where the page is dark. */
const INK = "#1c2430";
const FIXED_LINES = looks.fixed.lines as readonly Look["line"][];

/** One for each, in their order. The page does the same to the frames of all, so that this sets none apart. */
export function looksOf(runs: readonly Pick<PlannedRun, "mode" | "profile">[]): Look[] {
  let others = 0;
  return runs.map(({ mode, profile }) => {
    if (mode === "stateless" && typeof profile === "number") {
      return { colour: looks.fixed.colour, line: FIXED_LINES[profile % FIXED_LINES.length] ?? "solid" };
    }
    const known = KNOWN[mode === "stateless" ? profile : mode];
    if (known) return { ...known, colour: known.colour === INK ? "var(--text)" : known.colour };
    return { colour: looks.others[others++ % looks.others.length] ?? looks.fixed.colour, line: "solid" };
  });
}
