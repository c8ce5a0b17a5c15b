"""Makes an experiment's missing runs, and continues after a failed run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tigas_common.errors import StartError
from tigas_experiments.records.folder import RunRecord
from tigas_experiments.run.checks import changes
from tigas_experiments.run.environment import Environment, open_environment
from tigas_experiments.run.experiment import GIVE_UP_AFTER, Experiment
from tigas_experiments.run.measure import run
from tigas_experiments.wire.run import Configuration


@dataclass(frozen=True, slots=True)
class RunCallbacks:
    on_begin: Callable[[Configuration], None]
    on_stage: Callable[[str], None]
    """Receives the current step of the run."""
    on_finish: Callable[[RunRecord], None]


async def make_missing_runs(
    experiment: Experiment,
    missing: Sequence[Configuration],
    url: str | None,
    callbacks: RunCallbacks,
    *,
    allow_changes: bool = False,
) -> None:
    """Make an experiment's missing runs with the services at a URL or in the lab.

    Raises OSError, and StartError if nothing can start, if versions or inputs have changed since the kept runs, or
    after GIVE_UP_AFTER consecutive failures.
    """
    ladder, webgpu = experiment.plan.ladder, any(run.enhanced for run in missing)
    opened = open_environment(url, experiment.inputs, ladder=ladder, webgpu=webgpu)
    async with opened as environment:
        callbacks.on_stage("starting the services")
        await environment.check(missing)
        if not allow_changes:
            await _check_changes(experiment, missing, environment)
        experiment.write()
        await _make(experiment, missing, environment, callbacks)


async def _check_changes(experiment: Experiment, missing: Sequence[Configuration], environment: Environment) -> None:
    """Raise StartError if commit, browser, ladder or scenes differ from the kept runs'."""
    kept = experiment.kept(missing)
    if not kept:
        return
    changed = changes(kept, await environment.made_with(sorted({record.configuration.scene for record in kept})))
    if changed:
        raise StartError(
            f"Since the complete runs in {experiment.out} were made, there is another {' and another '.join(changed)}: "
            "choose another --out, or --allow-changes to combine them."
        )


async def _make(
    experiment: Experiment, missing: Sequence[Configuration], environment: Environment, callbacks: RunCallbacks
) -> None:
    failures = 0
    for configuration in missing:
        callbacks.on_begin(configuration)
        experiment.set_aside(configuration)
        record = await run(environment, configuration, experiment.folder(configuration), callbacks.on_stage)
        callbacks.on_finish(record)
        failures = 0 if record.status == "complete" else failures + 1
        if failures == GIVE_UP_AFTER:
            raise StartError(
                f"{failures} runs in a row failed, so the others are not tried; the same command continues. The last "
                f"failure: {record.problem}"
            )
