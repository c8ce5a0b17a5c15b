/** Over the stage: that a picture stands still although the camera moved, and for how long. */

import { Snowflake } from "lucide";
import type { ViewerSession } from "#viewer/session/session";
import { sideTitles } from "#viewer/sources/sides";
import { FROZEN_AFTER } from "#viewer/view/meter";
import { settings } from "../../state/app";
import { Icon } from "../icon";

export function Freeze({ session }: { session: ViewerSession }) {
  const names = sideTitles(settings.value);
  const frozen = [session.left, session.right.value].flatMap((side, i) => {
    const time = side?.figures?.frozenFor ?? 0;
    return time < FROZEN_AFTER ? [] : [{ name: names.length > 1 ? `${names[i]}: frozen` : "Frozen", time }];
  });
  if (session.phase.value.kind !== "playing" || frozen.length === 0) return null;
  return (
    <p class="floating freeze" data-stat="frozen">
      <Icon of={Snowflake} size={16} />
      {frozen.map(({ name, time }) => (
        <span key={name}>
          {name}, no new picture for {(time / 1000).toFixed(1)} s
        </span>
      ))}
    </p>
  );
}
