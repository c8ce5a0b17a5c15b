/** Copies a link to the present view to the clipboard and the address bar. */
import { useSignal } from "@preact/signals";
import { Check, Link2 } from "lucide";
import type { ViewerSession } from "#viewer/session/session";
import { showAddress } from "../../state/address";
import { IconButton } from "../icon-button";

/** Duration of the confirmation, in milliseconds. */
const SAID = 2000;

export function CopyLink({ session }: { session: ViewerSession }) {
  const copied = useSignal(false);
  const copy = async () => {
    showAddress(session);
    try {
      await navigator.clipboard.writeText(location.href);
      copied.value = true;
      setTimeout(() => {
        copied.value = false;
      }, SAID);
    } catch {
      prompt("The link to this view:", location.href); // no clipboard without HTTPS
    }
  };
  return (
    <IconButton
      icon={copied.value ? Check : Link2}
      label={copied.value ? "The link is copied" : "Copy a link to this view"}
      onClick={() => void copy()}
    />
  );
}
