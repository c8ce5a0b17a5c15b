/** The page: the list of scenes, the list of experiments, or the viewer, as the URL says. */
import { route } from "../state/app";
import { Dashboard } from "./dashboard";
import { ExperimentList } from "./experiment-list";
import { Viewer } from "./viewer";

export function App() {
  const current = route.value;
  if (current.page === "experiments") return <ExperimentList />;
  return current.page === "viewer" ? (
    <Viewer key={current.scene} sceneId={current.scene} stamp={current.stamp} />
  ) : (
    <Dashboard />
  );
}
