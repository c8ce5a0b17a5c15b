/** The page: the list of scenes, the list of experiments, or the viewer, as the URL says. */
import { unsaved } from "../experiment/movement-deck";
import { route } from "../state/app";
import { Dashboard } from "./dashboard";
import { experimentAtRisk } from "./experiment-lab";
import { ExperimentList } from "./experiment-list";
import { useLeavingWarning } from "./use-leaving-warning";
import { Viewer } from "./viewer";

export function App() {
  const current = route.value;
  useLeavingWarning(experimentAtRisk.value || unsaved.value.size > 0);
  if (current.page === "experiments") return <ExperimentList />;
  return current.page === "viewer" ? (
    <Viewer key={current.scene} sceneId={current.scene} stamp={current.stamp} />
  ) : (
    <Dashboard />
  );
}
