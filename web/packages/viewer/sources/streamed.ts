/** The registry's lines of modes with a stream of the packager's. */
import type { ServerConfig } from "#client/wire/render";
import type { Settings } from "../state/settings";
import { STREAM_NAMES, type StreamKind } from "../stream/stream";
import type { OpenSource, SourceKind, Variant } from "./source";

interface StreamMode {
  readonly kind: StreamKind;
  readonly variants?: readonly Variant[];
  /** The settings that determine how it is streamed. */
  readonly settings: readonly (keyof Settings)[];
  readonly load: () => Promise<OpenSource>;
}

export function streamed({ kind, variants, settings, load }: StreamMode): SourceKind {
  const title = STREAM_NAMES[kind];
  const motion = ["reprojection", "overscan"] as const;
  return {
    title,
    remedy: "Run tigas dash, and set it as “dash” in the server's upstreams.",
    ...(variants && { variants }),
    settings: [...settings, ...motion, "prediction"],
    reopens: [...settings, ...motion],
    requests: false,
    drawsHere: false,
    keepsHidden: false,
    charts: true,
    missing: (server) => (packagerOf(server) === undefined ? `This server does not offer ${title} streams` : null),
    load,
  };
}

export const packagerOf = (server: ServerConfig | null) => server?.services.dash;
