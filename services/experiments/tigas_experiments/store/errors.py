"""Errors of the store, and the translation of system errors."""

from __future__ import annotations

from functools import partial

from tigas_common import files
from tigas_common.errors import TigasError


class UnknownExperiment(TigasError):
    """No experiment has this id, or its record is unreadable."""

    status, type, title = 404, "unknown-experiment", "There is no such experiment"


class UnknownRun(TigasError):
    """The experiment has no run of this name."""

    status, type, title = 404, "unknown-run", "There is no such run"


class UnknownSample(TigasError):
    """The run has no such picture."""

    status, type, title = 404, "unknown-sample", "There is no such sample"


class UnknownMovement(TigasError):
    """No movement trace has this name."""

    status, type, title = 404, "unknown-movement", "There is no such movement"


class ExperimentInUse(TigasError):
    """The experiment is a command's, which alone may change it."""

    status, type, title = 409, "experiment-in-use", "The experiment is a command's"


class CannotStart(TigasError):
    """The services cannot make the experiment's runs."""

    status, type, title = 409, "cannot-start", "The experiment cannot be started"


class VersionsChanged(TigasError):
    """The complete runs were made by other versions, or with another ladder or scene."""

    status, type, title = 409, "versions-changed", "The versions have changed"


class RunMade(TigasError):
    """The run is complete, and is not changed any more."""

    status, type, title = 409, "run-complete", "The run is complete"


class NothingToReport(TigasError):
    """The experiment has no runs."""

    status, type, title = 409, "no-runs", "The experiment has no runs"


class NoSamples(TigasError):
    """No run of the experiment has samples."""

    status, type, title = 409, "no-samples", "The experiment has no samples"


class SamplesComplete(TigasError):
    """The run's samples are all there, and are not changed any more."""

    status, type, title = 409, "samples-complete", "The run's samples are complete"


storage_explained = partial(files.storage_explained, "results")
"""Turns the system's errors into DiskFull and StorageFailed."""
