/** Boxes with a message for the visitor. */
import { LockOpen } from "lucide";
import type { ComponentChildren } from "preact";
import { config } from "../state/app";
import { Icon } from "./button";

/** A box with a problem, in a sentence; nothing if there is no problem. */
export function Notice({ children }: { readonly children: ComponentChildren }) {
  if (children === null || children === undefined) return null;
  return (
    <p class="notice row" role="alert">
      {children}
    </p>
  );
}

/** Points visitors on plain HTTP from another device to the secure address, which has WebTransport. */
export function InsecureHint() {
  const url = config.value?.https_url;
  if (globalThis.isSecureContext || !url) return null;
  return (
    <p class="hint row">
      <Icon of={LockOpen} />
      <span>
        This page is not encrypted, so pictures arrive over a slower connection. Open <a href={url}>the secure page</a>
        (your browser will ask once whether you trust it).
      </span>
    </p>
  );
}
