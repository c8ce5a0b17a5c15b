/** A file being uploaded and checked: its progress, or its problem. */
import type { SceneUpload } from "../../uploads/scene-upload";
import { dismiss, tryAgain } from "../../uploads/uploads";
import { QuietButton } from "../button";
import { bytes } from "../format";

export function UploadCard({ upload }: { upload: SceneUpload }) {
  const { file } = upload;
  const state = upload.state.value;
  const failed = state.kind === "failed";
  return (
    <li class="card" data-upload={state.kind}>
      <div class="card-body">
        <h2>{file.name}</h2>
        {failed ? (
          <p class="card-error" role="alert">
            {state.message}
          </p>
        ) : (
          <>
            <progress
              aria-label={`Uploading ${file.name}`}
              max={file.size}
              {...(state.kind !== "checking" && { value: state.kind === "sending" ? state.sent : 0 })}
            />
            <p class="muted facts">
              {state.kind === "waiting" && "Waiting"}
              {state.kind === "sending" && `${bytes(state.sent)} of ${bytes(file.size)}`}
              {state.kind === "checking" && "Checking…"}
            </p>
          </>
        )}
      </div>
      <div class="card-foot row spread small">
        <span class="state" data-state={failed ? "broken" : "loading"}>
          {failed ? "Not added" : "Uploading"}
        </span>
        <span class="row">
          {failed && state.again && (
            <QuietButton aria-label={`Try again: ${file.name}`} onClick={() => tryAgain(upload)}>
              Try again
            </QuietButton>
          )}
          <QuietButton aria-label={`${failed ? "Dismiss" : "Cancel"}: ${file.name}`} onClick={() => dismiss(upload)}>
            {failed ? "Dismiss" : "Cancel"}
          </QuietButton>
        </span>
      </div>
    </li>
  );
}
