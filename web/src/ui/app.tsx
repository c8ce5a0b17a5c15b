/** The page: the list of scenes or the viewer, as the URL says. */
import { route } from "../state/app";
import { Dashboard } from "./dashboard";
import { Viewer } from "./viewer";

export function App() {
  const current = route.value;
  return current.page === "viewer" ? (
    <Viewer key={current.scene} sceneId={current.scene} stamp={current.stamp} />
  ) : (
    <Dashboard />
  );
}
