/** A viewer's report on its host, sent with the request for a host; the director of a cluster may name another one. */
import { mixedContent } from "../http/problem";
import type { ServerConfig } from "../wire/render";

/** URL of a path at the host itself, or through the director where a secure page may not reach the host. */
export function hostUrl(path: string, { host, render_url: base }: Pick<ServerConfig, "host" | "render_url">): string {
  if (typeof base !== "string") return path;
  return mixedContent(base, location.href) ? `${path}?${new URLSearchParams({ host: host ?? "" })}` : `${base}/${path}`;
}

/** The host works (`at`), does not answer (`silent`), or refused the session (`lost`). */
export type HostReport = { readonly at: string } | { readonly silent: string } | { readonly lost: string };

/** Undefined outside a cluster. */
export function hostReport(how: "at" | "silent" | "lost", { host }: ServerConfig): HostReport | undefined {
  return typeof host === "string" ? ({ [how]: host } as HostReport) : undefined;
}

/** Whether the viewer is sent to a different host, which has room for it. */
export function sentElsewhere(before: ServerConfig, now: ServerConfig): boolean {
  return (now.host ?? null) !== (before.host ?? null) && !isFull(now);
}

export function isFull({ retry_after_s }: ServerConfig): boolean {
  return typeof retry_after_s === "number";
}
