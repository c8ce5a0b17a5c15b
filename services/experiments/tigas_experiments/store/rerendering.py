"""Renders samples of experiments again on demand, one experiment at a time."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from tigas_common.errors import StartError
from tigas_common.render_requests import RenderClient, RenderUnavailable
from tigas_experiments.records.samples import read_sampled_run
from tigas_experiments.samples.rerender import lock_experiment, require_sampled_runs, rerender
from tigas_experiments.store.errors import ExperimentInUse, NoSamples, storage_errors
from tigas_experiments.store.experiments import Experiments
from tigas_experiments.store.metrics import MonitoredLock
from tigas_experiments.wire.store import Materialisation

logger = logging.getLogger(__name__)

MOST_PROBLEMS = 5
"""Maximum number of problems reported per experiment."""


@dataclass(slots=True)
class _Job:
    total: int
    done: int = 0
    problem: str | None = None
    task: asyncio.Task[None] | None = field(default=None, repr=False)
    """None once the job has ended."""


class RerenderingJobs:
    """Jobs of all experiments. Their results survive if the service is killed."""

    def __init__(self, experiments: Experiments, render: str) -> None:
        self._experiments = experiments
        self._render = render
        self._jobs: dict[str, _Job] = {}
        self.lock = MonitoredLock()

    @classmethod
    @asynccontextmanager
    async def connect(cls, experiments: Experiments, render: str) -> AsyncIterator[Self]:
        """Jobs that use the render service at a URL, cancelled at the end of the context."""
        made = cls(experiments, render)
        try:
            yield made
        finally:
            tasks = [job.task for job in made._jobs.values() if job.task is not None]
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def get(self, experiment: str) -> Materialisation:
        """Progress of an experiment's job. Raises UnknownExperiment."""
        folder, _ = await asyncio.to_thread(self._experiments.find, experiment)
        job = self._jobs.get(experiment)
        if job is not None and job.task is not None:
            return Materialisation(state="running", done=job.done, total=job.total, problem=None)
        total, done = await asyncio.to_thread(_progress, folder)
        return Materialisation(state="idle", done=done, total=total, problem=None if job is None else job.problem)

    async def start(self, experiment: str) -> Materialisation:
        """Start or continue a job. Raises UnknownExperiment, NoSamples and ExperimentInUse."""
        folder, _ = await asyncio.to_thread(self._experiments.find, experiment)
        try:
            runs = await asyncio.to_thread(require_sampled_runs, folder)
        except StartError:
            raise NoSamples("The experiment has no samples.") from None
        total, _ = await asyncio.to_thread(_progress, folder)
        job = self._jobs.get(experiment)
        if job is None or job.task is None:
            self._begin(experiment, folder, _Job(total), runs)
        return await self.get(experiment)

    async def stop(self, experiment: str) -> Materialisation:
        """Cancel a running job; results so far are kept. Raises UnknownExperiment."""
        job = self._jobs.get(experiment)
        if job is not None and job.task is not None:
            job.task.cancel()
            await asyncio.gather(job.task, return_exceptions=True)
        return await self.get(experiment)

    def _begin(self, experiment: str, folder: Path, job: _Job, runs: list[Path]) -> None:
        with storage_errors(), ExitStack() as stack:
            try:
                stack.enter_context(lock_experiment(folder))
            except StartError:
                raise ExperimentInUse(f"A command is using the experiment {experiment}.") from None
            lock = stack.pop_all()

        def ended(_: object) -> None:
            job.task = None
            lock.close()

        self._jobs[experiment] = job
        job.task = asyncio.create_task(self._work(job, runs))
        job.task.add_done_callback(ended)

    async def _work(self, job: _Job, runs: list[Path]) -> None:
        try:
            async with self.lock, RenderClient.connect(self._render) as renderer:
                job.problem = await _rerender_all(job, runs, renderer)
        except RenderUnavailable as error:
            job.problem = str(error)
        except OSError as error:
            job.problem = f"The store's disk reported an error: {error.strerror or error}."
        except Exception:
            logger.exception("Samples could not be rendered again")
            job.problem = "The store failed; its log says why."


async def _rerender_all(job: _Job, runs: list[Path], renderer: RenderClient) -> str | None:
    """Render one run after the other. Returns all problems, one sentence each. Raises RenderUnavailable and OSError."""
    before, problems = 0, []
    for run in runs:

        def on_progress(done: int, _: int, before: int = before) -> None:
            job.done = before + done

        found = await rerender(run, renderer, on_progress)
        before += len(found.samples)
        job.done = before
        problems += [f"{run.name}: {problem}" for problem in found.problems]
    return " ".join(problems[:MOST_PROBLEMS]) or None


def _progress(folder: Path) -> tuple[int, int]:
    """Number of samples, and number of complete ones."""
    try:
        found = [read_sampled_run(run) for run in require_sampled_runs(folder)]
    except StartError:
        return 0, 0
    total = sum(len(one.samples) for one in found)
    return total, total - sum(one.missing for one in found)
