/** On-screen controls for touch devices: a pad to walk, and two buttons to rise and sink. */
import { useSignal } from "@preact/signals";
import { ChevronDown, ChevronUp } from "lucide";
import { useEffect } from "preact/hooks";
import type { StageInput } from "#viewer/input/stage-input";
import { Icon } from "../button";

export function MovePad({ input }: { input: StageInput }) {
  const knob = useSignal({ x: 0, y: 0 });

  useEffect(
    () => () => {
      input.pad = { forward: 0, right: 0, up: 0 }; // a pad that disappears while held would keep walking
    },
    [input],
  );

  const follow = (event: PointerEvent & { currentTarget: HTMLElement }) => {
    const { left, top, width } = event.currentTarget.getBoundingClientRect();
    const radius = width / 2;
    const x = (event.clientX - left) / radius - 1;
    const y = (event.clientY - top) / radius - 1;
    const scale = 1 / Math.max(1, Math.hypot(x, y));
    knob.value = { x: x * scale, y: y * scale };
    input.pad = { ...input.pad, right: x * scale, forward: -y * scale };
  };
  const release = () => {
    knob.value = { x: 0, y: 0 };
    input.pad = { ...input.pad, right: 0, forward: 0 };
  };
  const rise = (up: number) => {
    input.pad = { ...input.pad, up };
  };

  return (
    <div class="move-pad row spread">
      <div
        class="floating pad"
        aria-hidden="true"
        onPointerDown={(event) => {
          event.currentTarget.setPointerCapture(event.pointerId);
          follow(event);
        }}
        onPointerMove={(event) => event.currentTarget.hasPointerCapture(event.pointerId) && follow(event)}
        onLostPointerCapture={release}
      >
        <span class="knob" style={{ transform: `translate(${knob.value.x * 32}px, ${knob.value.y * 32}px)` }} />
      </div>
      <div class="floating rise" aria-hidden="true">
        {([1, -1] as const).map((up) => (
          <span
            key={up}
            class="icon-button"
            onPointerDown={(event) => {
              event.currentTarget.setPointerCapture(event.pointerId);
              rise(up);
            }}
            onLostPointerCapture={() => rise(0)}
          >
            <Icon of={up > 0 ? ChevronUp : ChevronDown} size={22} />
          </span>
        ))}
      </div>
    </div>
  );
}
