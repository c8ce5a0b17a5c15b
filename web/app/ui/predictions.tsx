/** Options of the pose predictor. */
import { PREDICTOR_NAMES, PREDICTORS } from "#viewer/predict/registry";

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
