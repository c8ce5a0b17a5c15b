/** Server answers for tests. */
import { PAPER_LADDER } from "#client/abr/ladder";
import type { SceneInfo, ServerConfig } from "#client/wire/render";

export const COURTYARD: SceneInfo = {
  id: "courtyard",
  name: "Courtyard",
  state: "loaded",
  error: null,
  gaussians: 298_886,
  sh_degree: 3,
  file_bytes: 20_000_000,
  memory_bytes: 40_000_000,
  preview: "/scenes/courtyard/preview",
  up: [0, -1, 0],
  camera: { position: [0, -2, -8], look_at: [0, -2, 0] },
  background: [0, 0, 0],
};

export function serverConfig(services: Readonly<Record<string, string>> = {}): ServerConfig {
  return {
    version: "0.2.0",
    ladder: [...PAPER_LADDER],
    certificate_sha256: null,
    webtransport_url: null,
    https_url: null,
    services,
  };
}
