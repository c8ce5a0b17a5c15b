/** Boxes with a sentence for the visitor. */
import { LockOpen } from "lucide";
import type { ComponentChildren } from "preact";
import { config } from "../state/app";
import { Icon } from "./button";

/** A problem, in a sentence; nothing without one. */
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
        This page is not encrypted, so pictures arrive over a slower connection. Open <a href={url}>the secure page</a>
        (your browser will ask once whether you trust it).
      </span>
    </p>
  );
}
