/** What predicts the poses that frames are asked for, for a list to choose from. */
import { PREDICTIONS, type Prediction } from "../state/settings";

const NAMES: Readonly<Record<Prediction, string>> = {
  off: "Off",
  velocity: "Constant velocity",
  linear: "Linear model",
  input: "From keys and pointer",
  auto: "Automatic",
};

export function PredictionOptions() {
  return (
    <>
      {PREDICTIONS.map((name) => (
        <option key={name} value={name}>
          {NAMES[name]}
        </option>
      ))}
    </>
  );
}
