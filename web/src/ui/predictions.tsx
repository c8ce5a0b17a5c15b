/** What predicts the poses that frames are asked for, for a list to choose from. */
import { PREDICTOR_NAMES, PREDICTORS } from "../predict/registry";

export function PredictionOptions() {
  return (
    <>
      {PREDICTOR_NAMES.map((name) => (
        <option key={name} value={name}>
          {PREDICTORS[name].title}
        </option>
      ))}
    </>
  );
}
