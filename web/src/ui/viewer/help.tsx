/** A short help: every way to move, every key, and what the numbers mean. */

import { Dialog } from "../dialog";
import { EXPLANATIONS } from "./explanations";

const MOVES: readonly (readonly [string, readonly string[]])[] = [
  ["Look around", ["←", "→", "↑", "↓"]],
  ["Walk", ["W", "A", "S", "D"]],
  ["Rise", ["E", "Space"]],
  ["Sink", ["Q", "Shift"]],
  ["Faster, slower", ["C", "Z"]],
  ["Dragging: look or orbit", ["O"]],
  ["Look without dragging", ["L"]],
  ["Start view", ["R"]],
  ["Stop a movement", ["Esc"]],
  ["Next mode", ["M"]],
  ["Measurements", ["I"]],
  ["Experiment", ["X"]],
  ["Settings", ["P"]],
  ["Fullscreen", ["F"]],
  ["This help", ["H"]],
];

const POINTERS: readonly (readonly [string, string])[] = [
  ["Drag, or one finger", "Look around: the picture follows. With Alt, or after O: orbit"],
  ["Double click or tap", "Go half way there and look at it; orbiting goes around it"],
  ["Right button", "Slide sideways, up and down"],
  ["Wheel, or pinch", "Walk forward and back"],
  ["Two fingers", "Slide sideways, up and down"],
  ["Gamepad", "Sticks walk and turn, triggers rise and sink, bumpers change the speed"],
];

/** The main figures; every other one is explained where one points at it. */
const NUMBERS = [
  ["New views", EXPLANATIONS["new-views"]],
  ["Motion to photon", EXPLANATIONS["motion-to-photon"]],
  ["View latency", EXPLANATIONS["view-latency"]],
  ["Content age", EXPLANATIONS["content-age"]],
  ["Response time", EXPLANATIONS["round-trip"]],
  ["Server", EXPLANATIONS.server],
  ["Throughput", EXPLANATIONS.throughput],
] as const;

export function HelpDialog({ onClose }: { onClose: () => void }) {
  return (
    <Dialog
      title="Getting around"
      kind="help"
      light
      onClose={onClose}
      onKeyDown={({ key }) => ["h", "?"].includes(key.toLowerCase()) && onClose()}
    >
      <div>
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
    </Dialog>
  );
}
