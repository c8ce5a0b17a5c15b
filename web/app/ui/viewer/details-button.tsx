/** Switches between all measurements and one line. */
import { ChevronDown, ChevronUp } from "lucide";
import { changeSettings } from "../../state/app";
import { Icon } from "../icon";

export function DetailsButton({ details }: { readonly details: boolean }) {
  const label = details ? "Fewer measurements" : "More measurements";
  return (
    <button
      type="button"
      class="icon-button"
      aria-expanded={details}
      aria-label={label}
      title={label}
      onClick={() => changeSettings({ hudDetails: !details })}
    >
      <Icon of={details ? ChevronDown : ChevronUp} />
    </button>
  );
}
