/** Names of things that several parts of the page show. */
import type { Mode } from "../../state/settings";
import type { TransportChoice } from "../../transport/connect";
import type { Side } from "../../view/presented";

export const MODE_NAMES: Readonly<Record<Mode, string>> = {
  stateless: "Stateless",
  video: "Video",
  dash: "DASH",
  "side-by-side": "Side by side",
  local: "Local",
};

export const SIDE_NAMES: Readonly<Record<Side, string>> = {
  stateless: MODE_NAMES.stateless,
  dash: MODE_NAMES.dash,
  local: MODE_NAMES.local,
};

export const TRANSPORT_NAMES: Readonly<Record<TransportChoice, string>> = {
  auto: "Automatic",
  "webtransport-streams": "WebTransport streams",
  "webtransport-datagrams": "WebTransport datagrams",
  fetch: "HTTP fetch",
};
