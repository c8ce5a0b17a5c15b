/** Names of things that several parts of the page show. */

import type { Mode, Settings, SideMode } from "../../state/settings";
import { STREAM_NAMES, type StreamKind } from "../../stream/stream";
import type { TransportChoice } from "../../transport/connect";

export const MODE_NAMES: Readonly<Record<Mode, string>> = {
  stateless: "Stateless",
  video: "Video",
  ...STREAM_NAMES,
  "side-by-side": "Side by side",
  local: "Local",
};

/** Where the server names no packager. */
export const noPackager = (kind: StreamKind) => `This server has no packager for ${STREAM_NAMES[kind]} streams`;

/** Options of a comparison. */
export const SIDE_MODE_NAMES: Readonly<Record<SideMode, string>> = {
  stateless: MODE_NAMES.stateless,
  video: MODE_NAMES.video,
  "dash-typical": "DASH, typical",
  "dash-tuned": "DASH, tuned",
  "dash-edge": "DASH, edge",
  "dash-custom": "DASH, custom",
  webrtc: MODE_NAMES.webrtc,
  local: MODE_NAMES.local,
};

/** Labels of the pictures on the stage: the mode, or the compared options. */
export function sideNames({ mode, left, right }: Settings): readonly string[] {
  if (mode !== "side-by-side") return [MODE_NAMES[mode]];
  return [SIDE_MODE_NAMES[left], SIDE_MODE_NAMES[right]];
}

export const TRANSPORT_NAMES: Readonly<Record<TransportChoice, string>> = {
  auto: "Automatic",
  "webtransport-streams": "WebTransport streams",
  "webtransport-datagrams": "WebTransport datagrams",
  fetch: "HTTP fetch",
};
