/** All measurements: of single pictures with every figure, or else of each side in the same form. */
import type { ViewerSession } from "#viewer/session/session";
import { Hud } from "./hud";
import { SideFigures } from "./side-figures";

export function Figures({ session, linkNote }: { readonly session: ViewerSession; readonly linkNote: string | null }) {
  const source = session.source.value;
  const stats = source?.stats.value;
  if (source === null || stats?.kind !== "requests" || session.right.value) return <SideFigures session={session} />;
  return <Hud session={session} source={source} stats={stats} linkNote={linkNote} />;
}
