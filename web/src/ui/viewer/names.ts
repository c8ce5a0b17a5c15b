/** Names of transports. */
import type { TransportChoice } from "../../transport/connect";

export const TRANSPORT_NAMES: Readonly<Record<TransportChoice, string>> = {
  auto: "Automatic",
  "webtransport-streams": "WebTransport streams",
  "webtransport-datagrams": "WebTransport datagrams",
  fetch: "HTTP fetch",
};
