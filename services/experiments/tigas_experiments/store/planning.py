"""Expands an experiment's file that a page sent, and keeps its inputs; runs in a process with limits."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path

from tigas_common.errors import InvalidRequest, StartError
from tigas_common.offload import Limit
from tigas_common.parsing import parse
from tigas_common.wire.render import SceneInfo
from tigas_experiments.movement.generated import KINDS
from tigas_experiments.movement.trace import MovementTrace
from tigas_experiments.records.folder import ExperimentRecord, InputDigests
from tigas_experiments.run.experiment import Experiment
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.run.plan import ExperimentPlan
from tigas_experiments.store.errors import storage_explained
from tigas_experiments.wire.movement import TimedPose
from tigas_experiments.wire.run import Configuration
from tigas_experiments.wire.store import ExperimentRequest

MAX_REQUEST_BYTES = 16_000_000
"""Maximum size of a request that creates an experiment, with its movements."""
LIMIT = Limit(memory=1_000_000_000, cpu_s=60)
INPUTS = "inputs"
"""The folder of an experiment's movements."""


class BrokenPlan(InvalidRequest):
    """The experiment's file cannot be expanded."""


def expand(body: bytes, movements: Path, out: Path) -> tuple[Experiment, Mapping[str, float]]:
    """An experiment in a new folder, with copies of its movements, and the durations of the shaper's traces.

    The file names movements of the request, of the directory `movements`, and generated ones. Raises InvalidRequest,
    BrokenPlan with one sentence, and DiskFull.
    """
    request = parse(ExperimentRequest, body, MAX_REQUEST_BYTES)
    try:
        plan = ExperimentPlan.parse(request.file, "The file")
        _check_names((*plan.movements, *plan.networks))
        with storage_explained():
            (out / INPUTS).mkdir(parents=True)
            for name in plan.movements:
                if name not in KINDS:
                    _keep_movement(name, request.movements, movements, out / INPUTS)
        experiment = Experiment.of(plan, out / INPUTS, out, traces_s=request.traces_s)
        for run in {run.movement: run for run in experiment.runs}.values():
            experiment.inputs.movement(run)
    except StartError as error:
        raise BrokenPlan(str(error)) from None
    return experiment, request.traces_s


def reopen(folder: Path, record: ExperimentRecord) -> Experiment:
    """A page's experiment in its folder. Raises InvalidRequest."""
    try:
        plan = ExperimentPlan.of(record.plan, "Another version made this experiment, so it cannot be resumed")
        experiment = Experiment.of(plan, folder / INPUTS, folder, traces_s=record.traces_s)
        experiment.missing()  # all of its inputs are there
    except StartError as error:
        raise InvalidRequest(str(error)) from None
    return experiment


def placed_points(
    inputs: Inputs, configuration: Configuration, scene: SceneInfo
) -> tuple[list[TimedPose], InputDigests]:
    """The poses of a run in a scene. Raises InvalidRequest."""
    try:
        return inputs.points(configuration, scene), inputs.digests(configuration)
    except StartError as error:
        raise InvalidRequest(str(error)) from None


def _check_names(names: Iterable[str]) -> None:
    """Raises StartError for a path."""
    for name in names:
        if Path(name).name != name or not name.isprintable():
            raise StartError(f"{name[:100]!r} must not be a path: the store has its own files.")


def _keep_movement(name: str, own: Mapping[str, str], movements: Path, inputs: Path) -> None:
    """Raises StartError and OSError."""
    if (text := own.get(name)) is not None:
        MovementTrace.parse(text, name)
        (inputs / name).write_text(text, encoding="utf-8")
    elif movements / name in movements.glob("*.csv"):
        shutil.copyfile(movements / name, inputs / name)
    else:
        raise StartError(f"There is no movement {name!r}: neither a file of the store nor one of {', '.join(KINDS)}.")
