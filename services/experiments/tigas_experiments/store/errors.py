"""Errors of the store, and the translation of system errors."""

from __future__ import annotations

from functools import partial

from tigas_common import files
from tigas_common.errors import TigasError


class UnknownExperiment(TigasError):
    status, type, title = 404, "unknown-experiment", "There is no such experiment"


class UnknownRun(TigasError):
    status, type, title = 404, "unknown-run", "There is no such run"


class UnknownSample(TigasError):
    status, type, title = 404, "unknown-sample", "There is no such sample"


class UnknownMovement(TigasError):
    status, type, title = 404, "unknown-movement", "There is no such movement"


class ExperimentInUse(TigasError):
    status, type, title = 409, "experiment-in-use", "The experiment belongs to a command"


class CannotStart(TigasError):
    status, type, title = 409, "cannot-start", "The experiment cannot be started"


class VersionsChanged(TigasError):
    status, type, title = 409, "versions-changed", "The versions have changed"


class RunMade(TigasError):
    status, type, title = 409, "run-complete", "The run is complete"


class NothingToReport(TigasError):
    status, type, title = 409, "no-runs", "The experiment has no runs"


class NoSamples(TigasError):
    status, type, title = 409, "no-samples", "The experiment has no samples"


class SamplesComplete(TigasError):
    status, type, title = 409, "samples-complete", "The run's samples are complete"


storage_errors = partial(files.storage_errors, "results")
"""Turns OSErrors into DiskFull and StorageFailed."""
