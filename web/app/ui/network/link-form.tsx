/** Sets a constant link. Errors are shown under their fields; typed values are kept. */
import { useSignal } from "@preact/signals";
import type { TargetedSubmitEvent } from "preact";
import type { LinkSetting } from "#client/wire/shaper";
import { draftOf, LINK_FIELDS, type LinkProblems, parseLink } from "#lab/network/link-form";

interface Props {
  /** Initial values of the fields. */
  readonly link: LinkSetting;
  readonly onLink: (setting: LinkSetting) => void;
}

export function LinkForm({ link, onLink }: Props) {
  const draft = useSignal(draftOf(link));
  const problems = useSignal<LinkProblems>({});
  const submit = (event: TargetedSubmitEvent<HTMLFormElement>) => {
    event.preventDefault();
    const parsed = parseLink(draft.value);
    problems.value = "problems" in parsed ? parsed.problems : {};
    if ("setting" in parsed) onLink(parsed.setting);
  };
  const wrong = LINK_FIELDS.flatMap(({ name }) => problems.value[name] ?? []);
  return (
    <form class="link-form" aria-label="Constant link" noValidate onSubmit={submit}>
      <div class="fields">
        {LINK_FIELDS.map(({ name, label, unit }) => (
          <label key={name} class="number-field">
            <span>
              {label} <span class="muted">{unit}</span>
            </span>
            <input
              type="text"
              inputMode="decimal"
              autocomplete="off"
              aria-invalid={name in problems.value}
              aria-describedby="link-problems"
              value={draft.value[name]}
              onInput={({ currentTarget }) => {
                draft.value = { ...draft.value, [name]: currentTarget.value };
              }}
            />
          </label>
        ))}
      </div>
      <div id="link-problems" class="problems" role="alert">
        {wrong.map((sentence) => (
          <p key={sentence}>{sentence}</p>
        ))}
      </div>
      <button type="submit" class="quiet-button">
        Set constant link
      </button>
    </form>
  );
}
