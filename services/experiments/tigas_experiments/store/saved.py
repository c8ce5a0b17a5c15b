"""Imports a file saved by a page without a store as an experiment's folder."""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from pydantic import JsonValue, ValidationError

from tigas_common.errors import StartError
from tigas_common.files import read_regular
from tigas_common.parsing import sentence
from tigas_common.wire.model import Entries, WireModel
from tigas_experiments.records.folder import ExperimentRecord, write_experiment
from tigas_experiments.records.machine import this_machine
from tigas_experiments.store.upload import write_run
from tigas_experiments.wire.recording import MAX_BYTES
from tigas_experiments.wire.store import ExperimentName, Plan, RunUpload

MAX_SAVED_BYTES = 8 * MAX_BYTES


class SavedExperiment(WireModel):
    """The file (`web/src/experiment/results.ts` writes it)."""

    name: ExperimentName
    created: str
    source: Literal["page"]
    plan: Plan
    runs: Entries[dict[str, JsonValue]]
    """Uploads with their results; without a recording for failed runs."""


def import_saved(file: Path, out: Path) -> None:
    """Write an experiment into a new folder atomically.

    Raises OSError, and StartError with one sentence for an invalid file, a file without recordings, or an existing
    folder.
    """
    if out.exists():
        raise StartError(f"{out} already exists; choose another folder with --out.")
    try:
        saved = SavedExperiment.model_validate_json(read_regular(file, MAX_SAVED_BYTES))
    except ValidationError as error:
        raise StartError(f"{file} is no experiment that the page saved: {sentence(error)}") from None
    uploads = [
        _upload(f"{file}, run {number}", run)
        for number, run in enumerate(saved.runs, 1)
        if run.get("recording") is not None
    ]
    if not uploads:
        raise StartError(f"{file} has no run that was recorded.")
    out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=".import-", dir=out.parent) as hidden:
        folder, machine = Path(hidden, "experiment"), this_machine()
        write_experiment(
            folder,
            ExperimentRecord(
                name=saved.name, created=saved.created, source="page", plan=saved.plan, planned=len(saved.runs)
            ),
        )
        for number, upload in enumerate(uploads, 1):
            write_run(folder / "runs" / f"{number:02}_{upload.configuration.slug}", upload, (), machine)
        folder.rename(out)


def _upload(name: str, run: dict[str, JsonValue]) -> RunUpload:
    try:
        return RunUpload.model_validate_json(json.dumps({key: run.get(key) for key in RunUpload.model_fields}))
    except ValidationError as error:
        raise StartError(f"{name}: {sentence(error)}") from None
