/** Boxes with a sentence for the visitor. */
import { LockOpen } from "lucide";
import type { ComponentChildren } from "preact";
import { config } from "../state/app";
import { Icon } from "./button";

/** What went wrong; nothing without a sentence. */
export function Notice({ children }: { readonly children: ComponentChildren }) {
  if (children === null || children === undefined) return null;
  return (
    <p class="notice row" role="alert">
      {children}
    </p>
  );
}

/** Points visitors over plain HTTP from another device to the address with WebTransport. */
export function InsecureHint() {
  const url = config.value?.https_url;
  if (globalThis.isSecureContext || !url) return null;
  return (
    <p class="hint row">
      <Icon of={LockOpen} />
      <span>
        Over plain HTTP, frames come by fetch. For WebTransport open <a href={url}>the secure page</a> and accept its
        certificate once.
      </span>
    </p>
  );
}
