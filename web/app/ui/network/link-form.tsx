/** Sets a constant link. Errors are shown under their fields; typed values are kept. */
import type { TargetedSubmitEvent } from "preact";
import { useState } from "preact/hooks";
import type { LinkSetting } from "#client/wire/shaper";
import { draftOf, LINK_FIELDS, type LinkProblems, parseLink } from "#lab/network/link-form";
import { QuietButton } from "../button";
import { TextField } from "../fields";

interface Props {
  readonly link: LinkSetting;
  readonly onLink: (setting: LinkSetting) => void;
}

export function LinkForm({ link, onLink }: Props) {
  const [draft, setDraft] = useState(() => draftOf(link));
  const [problems, setProblems] = useState<LinkProblems>({});
  const submit = (event: TargetedSubmitEvent<HTMLFormElement>) => {
    event.preventDefault();
    const parsed = parseLink(draft);
    setProblems("problems" in parsed ? parsed.problems : {});
    if ("setting" in parsed) onLink(parsed.setting);
  };
  const wrong = LINK_FIELDS.flatMap(({ name }) => problems[name] ?? []);
  return (
    <form class="link-form stack" aria-label="Constant link" noValidate onSubmit={submit}>
      <div class="fields">
        {LINK_FIELDS.map(({ name, label, unit }) => (
          <TextField
            key={name}
            label={label}
            unit={unit}
            numeric
            invalid={name in problems}
            problems="link-problems"
            value={draft[name]}
            onValue={(value) => setDraft({ ...draft, [name]: value })}
          />
        ))}
      </div>
      <div id="link-problems" class="problems" role="alert">
        {wrong.map((sentence) => (
          <p key={sentence}>{sentence}</p>
        ))}
      </div>
      <QuietButton type="submit">Set constant link</QuietButton>
    </form>
  );
}
