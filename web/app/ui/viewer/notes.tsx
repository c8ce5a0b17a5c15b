/** Notices next to a picture's figures, and the button that switches between all figures and one line. */
import { ChevronDown, ChevronUp } from "lucide";
import type { EnhancementStatus } from "#viewer/enhance/enhancement";
import { changeSettings } from "../../state/app";
import { IconButton } from "../button";

export function DetailsButton({ details }: { readonly details: boolean }) {
  return (
    <IconButton
      icon={details ? ChevronDown : ChevronUp}
      label={details ? "Fewer measurements" : "More measurements"}
      aria-expanded={details}
      onClick={() => changeSettings({ hudDetails: !details })}
    />
  );
}

/** Sentences by name, most important first; null for none. */
export type Said = Readonly<Record<string, string | null>>;

/** Shows at most `most` of them: more would cover the picture. */
export function Notes({ of, most }: { of: Said; most: number }) {
  const notes = Object.entries(of).filter(([, sentence]) => sentence !== null);
  return (
    <>
      {notes.slice(0, most).map(([name, sentence]) => (
        <p key={name} class="hud-note" role="status" data-stat={name}>
          {sentence}
        </p>
      ))}
    </>
  );
}

/** Null if enhancement works as chosen. */
export function enhancementNote(status: EnhancementStatus): string | null {
  if (status.kind === "failed") return `Enhancement is off. ${status.message}`;
  return status.kind === "starting" ? status.message : null;
}

/** Notice that a faster link would not deliver frames sooner. */
export function serverNote({ serverBound }: { readonly serverBound: boolean }): string | null {
  return serverBound ? "The server is slow to draw this scene; your connection is fine." : null;
}
