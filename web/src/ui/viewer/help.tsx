/** A short help: every way to move, every key, and what the numbers mean. */

import type { Signal } from "@preact/signals";
import { X } from "lucide";
import { useEffect, useRef } from "preact/hooks";
import { IconButton } from "../icon-button";

const MOVES: readonly (readonly [string, readonly string[]])[] = [
  ["Look around", ["←", "→", "↑", "↓"]],
  ["Walk", ["W", "A", "S", "D"]],
  ["Rise, sink", ["Space", "Shift"]],
  ["Start view", ["R"]],
  ["Stop a movement", ["Esc"]],
  ["Stateless, DASH, both", ["M"]],
  ["Measurements", ["I"]],
  ["Experiment", ["E"]],
  ["Settings", ["P"]],
  ["Fullscreen", ["F"]],
  ["This help", ["H"]],
];

const POINTERS: readonly (readonly [string, string])[] = [
  ["Drag, or one finger", "Look around: the picture follows"],
  ["Wheel, or pinch", "Walk forward and back"],
  ["Two fingers", "Slide sideways, up and down"],
];

const NUMBERS: readonly (readonly [string, string])[] = [
  ["New views", "Pictures of another pose than the one before: repeated and refined frames do not count."],
  ["Motion to photon", "From the moment that your input was read to the first frame on the screen that shows it."],
  ["View latency", "The same while frames are turned: until the picture has turned with you, whatever the network."],
  ["Content age", "How old the pixels are: from the pose that they were rendered for until you see them."],
  ["Response time", "From sending a request to the last byte of its frame."],
  ["Server", "Waiting, rendering and encoding, as the server measured them."],
  ["Throughput", "How fast the network delivered the last frames."],
];

export function HelpDialog({ open }: { open: Signal<boolean> }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const shown = open.value;
  useEffect(() => {
    if (shown) dialog.current?.showModal();
    else dialog.current?.close();
  }, [shown]);
  const close = () => {
    open.value = false;
  };
  return (
    <dialog
      ref={dialog}
      class="help"
      aria-labelledby="help-title"
      onClose={close}
      onClick={(event) => event.target === event.currentTarget && close()}
      onKeyDown={(event) => ["h", "?"].includes(event.key.toLowerCase()) && close()}
    >
      <div class="help-content">
        <header>
          <h2 id="help-title">Getting around</h2>
          <IconButton icon={X} label="Close" onClick={close} />
        </header>
        <dl class="keys">
          {MOVES.map(([what, keys]) => (
            <div key={what}>
              <dt>{what}</dt>
              <dd>
                {keys.map((key) => (
                  <kbd key={key}>{key}</kbd>
                ))}
              </dd>
            </div>
          ))}
        </dl>
        <dl class="meanings">
          {[...POINTERS, ...NUMBERS].map(([what, meaning]) => (
            <div key={what}>
              <dt>{what}</dt>
              <dd>{meaning}</dd>
            </div>
          ))}
        </dl>
      </div>
    </dialog>
  );
}
