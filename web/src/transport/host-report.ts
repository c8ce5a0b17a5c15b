/** What a viewer says of its host when it asks which one serves it; the director of a cluster sends it elsewhere for it. */
import type { ServerConfig } from "../wire/render";

/** All is well there (`at`), nothing is heard of it (`silent`), or it could not be got into (`lost`). */
export type HostReport = { readonly at: string } | { readonly silent: string } | { readonly lost: string };

/** Undefined outside of a cluster, where there is nothing to choose. */
export function hostReport(how: "at" | "silent" | "lost", { host }: ServerConfig): HostReport | undefined {
  return typeof host === "string" ? ({ [how]: host } as HostReport) : undefined;
}

/** Whether another host than before is to serve the viewer, and takes it. */
export function sentElsewhere(before: ServerConfig, now: ServerConfig): boolean {
  return (now.host ?? null) !== (before.host ?? null) && !isFull(now);
}

export function isFull({ retry_after_s }: ServerConfig): boolean {
  return typeof retry_after_s === "number";
}
