/** Where the page asks the host that it was sent to. */
import { mixedContent } from "../http/reach";
import type { ServerConfig } from "../wire/render";

/** URL of a path at the host itself, or through the director where a secure page may not reach the host. */
export function hostUrl(path: string, { host, render_url: base }: Pick<ServerConfig, "host" | "render_url">): string {
  if (typeof base !== "string") return path;
  return mixedContent(base, location.href) ? `${path}?${new URLSearchParams({ host: host ?? "" })}` : `${base}/${path}`;
}
