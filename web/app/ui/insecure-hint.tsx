/** Points visitors over plain HTTP from another device to the address with WebTransport. */

import { LockOpen } from "lucide";
import { config } from "../state/app";
import { Icon } from "./icon";

export function InsecureHint() {
  const url = config.value?.https_url;
  if (globalThis.isSecureContext || !url) return null;
  return (
    <p class="hint">
      <Icon of={LockOpen} />
      <span>
        Over plain HTTP, frames come by fetch. For WebTransport open <a href={url}>the secure page</a> and accept its
        certificate once.
      </span>
    </p>
  );
}
