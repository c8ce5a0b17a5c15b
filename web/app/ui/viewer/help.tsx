/** The help: navigation, keyboard shortcuts, and the meaning of the figures. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Dialog } from "../dialog";
import { EXPLANATIONS } from "./explanations";
import { actionOf } from "./hooks";
import { Toggle } from "./setting";

const MOVES: readonly (readonly [string, readonly string[]])[] = [
  ["Look around", ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"]],
  ["Walk", ["KeyW", "KeyA", "KeyS", "KeyD"]],
  ["Move up", ["KeyE", "Space"]],
  ["Move down", ["KeyQ", "Shift"]],
  ["Faster, slower", ["KeyC", "KeyZ"]],
  ["Toggle look or orbit", ["KeyO"]],
  ["Mouse look (locks the pointer)", ["KeyL"]],
  ["Back to the start", ["KeyR"]],
  ["Stop playback", ["Esc"]],
  ["Save a picture", ["KeyT"]],
  ["Next mode", ["KeyM"]],
  ["Measurements", ["KeyI"]],
  ["Experiment", ["KeyX"]],
  ["Lab", ["KeyP"]],
  ["Fullscreen", ["KeyF"]],
  ["This help", ["KeyH"]],
];

const ARROWS: Readonly<Record<string, string>> = { ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓" };

const POINTERS: readonly (readonly [string, string])[] = [
  ["Drag, or one finger", "Look around; orbit with Alt, or after pressing O"],
  ["Double-click or double-tap", "Move halfway there and look at it; orbiting then circles that point"],
  ["Right-drag", "Slide sideways, up and down"],
  ["Wheel, or pinch", "Walk forwards and backwards"],
  ["Two fingers", "Slide sideways, up and down"],
  ["Gamepad", "Sticks walk and turn, triggers move up and down, bumpers change the speed"],
];

/** The main figures; the others are explained by tooltips. */
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
  const label = useKeyLabels();
  return (
    <Dialog
      title="Getting around"
      kind="help"
      light
      onClose={onClose}
      onKeyDown={(event) => actionOf(event) === "help" && onClose()}
    >
      <div>
        <dl class="keys columns">
          {MOVES.filter(([what]) => what !== "Fullscreen" || document.fullscreenEnabled).map(([what, keys]) => (
            <div key={what} class="row spread">
              <dt>{what}</dt>
              <dd class="row">
                {keys.map((key) => (
                  <kbd key={key}>{label(key)}</kbd>
                ))}
              </dd>
            </div>
          ))}
        </dl>
        <Toggle name="shortcuts" />
        <Meanings of={POINTERS} />
        <details>
          <summary>Measurements in the lab</summary>
          <Meanings of={NUMBERS} />
        </details>
      </div>
    </Dialog>
  );
}

function Meanings({ of }: { readonly of: readonly (readonly [string, string])[] }) {
  return (
    <dl class="meanings stack small">
      {of.map(([what, meaning]) => (
        <div key={what}>
          <dt>{what}</dt>
          <dd class="muted">{meaning}</dd>
        </div>
      ))}
    </dl>
  );
}

type Layout = ReadonlyMap<string, string>;

/** The label of a key on the user's keyboard where available (Chromium), else on a US keyboard. */
function useKeyLabels(): (code: string) => string {
  const layout = useSignal<Layout>(new Map());
  useEffect(() => {
    const { keyboard } = navigator as { keyboard?: { getLayoutMap(): Promise<Layout> } };
    keyboard?.getLayoutMap().then(
      (known) => {
        layout.value = known;
      },
      () => undefined, // not allowed in frames of other origins
    );
  }, [layout]);
  return (code) => ARROWS[code] ?? layout.value.get(code)?.toUpperCase() ?? code.replace("Key", "");
}
