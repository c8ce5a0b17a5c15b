/** The page: the list of scenes, the list of experiments or the viewer, depending on the URL. */
import { unsaved } from "#viewer/movement/movement-deck";
import { exporting, outdated, route } from "./state/app";
import type { Route } from "./state/route";
import { Dashboard } from "./ui/dashboard/dashboard";
import { useLeavingWarning } from "./ui/hooks";
import { lazy } from "./ui/lazy";
import { Viewer } from "./ui/viewer/viewer";
import { isUploading } from "./uploads/uploads";

const ExperimentList = lazy(async () => (await import("./ui/experiment/experiment-list")).ExperimentList);
const RunPage = lazy(async () => (await import("./ui/experiment/run-page")).RunPage);
const SamplesPage = lazy(async () => (await import("./ui/experiment/samples-page")).SamplesPage);

export function App() {
  const current = route.value;
  useLeavingWarning(unsaved.value.size > 0 || isUploading.value || exporting.value);
  return (
    <>
      {outdated.value && (
        <p class="notice row outdated" role="alert">
          TIGAS was updated on the server.{" "}
          <button type="button" onClick={() => location.reload()}>
            Reload
          </button>
        </p>
      )}
      <Page current={current} />
    </>
  );
}

function Page({ current }: { readonly current: Route }) {
  if (current.page === "experiments") return <ExperimentList />;
  if (current.page === "run") return <RunPage key={current.experiment} id={current.experiment} />;
  if (current.page === "samples") return <SamplesPage key={current.experiment} id={current.experiment} />;
  return current.page === "viewer" ? (
    <Viewer
      key={current.scene}
      sceneId={current.scene}
      asked={current.asked}
      unknown={current.unknown}
      bare={current.bare ?? false}
    />
  ) : (
    <Dashboard />
  );
}
