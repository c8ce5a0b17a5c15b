"""Work on data from pages, in a process with limits: expanding experiment files and storing performed runs."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

from tigas_common.errors import InvalidRequest, StartError
from tigas_common.files import flush_tree
from tigas_common.offload import Limit
from tigas_common.parsing import parse
from tigas_common.wire.render import SceneInfo
from tigas_experiments.errors import RunFailed
from tigas_experiments.movement.generated import KINDS
from tigas_experiments.movement.trace import MovementTrace
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import ExperimentRecord, InputDigests, RunRecord, RunWriter, StoredRun
from tigas_experiments.records.load import LoadSample
from tigas_experiments.records.machine import Machine
from tigas_experiments.run.experiment import Experiment
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.run.job import RunSources, complete, write_records
from tigas_experiments.run.plan import ExperimentPlan
from tigas_experiments.store.errors import storage_errors
from tigas_experiments.wire.movement import TimedPose
from tigas_experiments.wire.recording import MAX_BYTES
from tigas_experiments.wire.run import Configuration
from tigas_experiments.wire.store import ExperimentRequest, RunUpload, mismatch

MAX_REQUEST_BYTES = 16_000_000
"""Maximum size of a request that creates an experiment, including its movements."""
LIMIT = Limit(memory=1_000_000_000, cpu_s=60)
COMPARE = Limit(memory=2_000_000_000, cpu_s=1200)
"""Limit for comparing a run's captures with ground truth."""
INPUTS = "inputs"
"""Folder of an experiment's movements."""


class BrokenPlan(InvalidRequest):
    """The experiment file cannot be expanded."""


def expand(body: bytes, movements: Path, out: Path) -> tuple[Experiment, Mapping[str, float]]:
    """Create an experiment in a new folder with copies of its movements; also returns durations of the shaper's traces.

    The file may name movements in the request or in the directory `movements`, and generated ones. Raises
    InvalidRequest, BrokenPlan with one sentence, and DiskFull.
    """
    request = parse(ExperimentRequest, body, MAX_REQUEST_BYTES)
    try:
        plan = ExperimentPlan.parse(request.file, "The file")
        _check_names((*plan.movements, *plan.networks))
        with storage_errors():
            (out / INPUTS).mkdir(parents=True)
            for name in plan.movements:
                if name not in KINDS:
                    _copy_movement(name, request.movements, movements, out / INPUTS)
        experiment = Experiment.from_plan(plan, out / INPUTS, out, traces_s=request.traces_s)
        for run in {run.movement: run for run in experiment.runs}.values():
            experiment.inputs.movement(run)
    except StartError as error:
        raise BrokenPlan(str(error)) from None
    return experiment, request.traces_s


def reopen(folder: Path, record: ExperimentRecord) -> Experiment:
    """Open a page's experiment from its folder. Raises InvalidRequest."""
    try:
        plan = ExperimentPlan.from_data(record.plan, "Another version made this experiment, so it cannot be resumed")
        experiment = Experiment.from_plan(plan, folder / INPUTS, folder, traces_s=record.traces_s)
        experiment.missing()  # checks that all inputs exist
    except StartError as error:
        raise InvalidRequest(str(error)) from None
    return experiment


def placed_points(
    inputs: Inputs, configuration: Configuration, scene: SceneInfo
) -> tuple[list[TimedPose], InputDigests]:
    """The poses of a run in a scene, and the digests of its inputs. Raises InvalidRequest."""
    try:
        return inputs.points(configuration, scene), inputs.digests(configuration)
    except StartError as error:
        raise InvalidRequest(str(error)) from None


def _check_names(names: Iterable[str]) -> None:
    """Raise StartError for any path."""
    for name in names:
        if Path(name).name != name or not name.isprintable():
            raise StartError(f"{name[:100]!r} must not be a path: only the store's files can be used.")


def _copy_movement(name: str, own: Mapping[str, str], movements: Path, inputs: Path) -> None:
    """Copy a movement from the request or the store, unless it is generated. Raises StartError and OSError."""
    if (text := own.get(name)) is not None:
        MovementTrace.parse(text, name)
        (inputs / name).write_text(text, encoding="utf-8")
    elif movements / name in movements.glob("*.csv"):
        shutil.copyfile(movements / name, inputs / name)
    else:
        raise StartError(f"There is no movement {name!r}: neither a file of the store nor one of {', '.join(KINDS)}.")


def check_limit(size: int) -> Limit:
    """Resource limits of `keep_upload` for a body of `size` bytes.

    A page's run of 20 Mbit/s takes 13 times its size in memory, and a quarter of a second per megabyte.
    """
    return Limit(memory=256_000_000 + 20 * size, cpu_s=30 + 2 * size // 1_000_000)


def keep_upload(
    body: Path,
    folder: Path,
    configuration: Configuration,
    made_from: RunSources,
    load: Sequence[LoadSample],
    machine: Machine,
) -> RunRecord:
    """Write an uploaded run into a new folder.

    `load` is this machine's recent load. Raises InvalidRequest and DiskFull.
    """
    with storage_errors():
        upload = parse(RunUpload, body.read_bytes(), MAX_BYTES)
        recording = upload.recording
        if recording is not None and (problem := mismatch(configuration, recording)):
            raise InvalidRequest(problem)
        started = (
            datetime.now(UTC) if recording is None else datetime.fromtimestamp(recording.started_unix_ms / 1000, UTC)
        )
        record = RunRecord(
            configuration=configuration,
            machine=machine,
            started=started.isoformat(timespec="seconds"),
        )
        browser = None if recording is None else _browser(recording.user_agent)
        record = write_records(RunWriter(folder, record), upload, load, made_from, browser=browser)
        flush_tree(folder)
        return record


def complete_upload(folder: Path, render: str) -> None:
    """Complete a run that has all its captures, or mark it as failed. Raises DiskFull."""
    with storage_errors():
        try:
            asyncio.run(complete(folder, render))
        except (RunFailed, BrokenRecording) as error:
            RunWriter.resume(StoredRun(folder)).close(status="failed", problem=str(error))


def _browser(user_agent: str) -> str | None:
    """Version of the browser: `156.0.0.0` for Chromium, `152.0` for Firefox."""
    for name in ("Chrome/", "Firefox/", "Version/"):
        _, found, rest = user_agent.partition(name)
        if found:
            return rest.split()[0][:40] if rest.split() else None
    return None
