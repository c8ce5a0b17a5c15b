"""Assigns an experiment's runs to pages, one at a time to each, and accepts the performed ones."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from tigas_common.errors import DiskFull, StartError, StorageFailed
from tigas_common.files import flush_folder
from tigas_common.offload import Offload
from tigas_common.wire.render import SceneInfo, ServerConfig
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.load import LoadSample
from tigas_experiments.records.machine import Machine, Server
from tigas_experiments.report.controllers import run_names
from tigas_experiments.run.checks import RunVersions, check_services, find_changes
from tigas_experiments.run.experiment import GIVE_UP_AFTER, RUNS, Experiment
from tigas_experiments.run.inputs import points_sha256
from tigas_experiments.run.job import RunSources, page_settings, run_plan
from tigas_experiments.run.plan import estimate_seconds, format_duration
from tigas_experiments.run.targets import Target, load_scene, read_config
from tigas_experiments.store.errors import (
    CannotStart,
    RunMade,
    UnknownExperiment,
    UnknownRun,
    VersionsChanged,
    storage_errors,
)
from tigas_experiments.store.experiments import Experiments
from tigas_experiments.store.limited import (
    COMPARE,
    LIMIT,
    BrokenPlan,
    check_limit,
    complete_upload,
    expand,
    keep_upload,
    placed_points,
    reopen,
)
from tigas_experiments.store.metrics import MonitoredLock
from tigas_experiments.store.workspace import Workspace
from tigas_experiments.wire.movement import TimedPose
from tigas_experiments.wire.run import Configuration
from tigas_experiments.wire.store import NextRequest, NextRun, PlanSummary, RunJob, RunRow

LEASE_S = 300.0
"""Seconds that a page may take for a run beyond its warm-up and movement, as it sends nothing during the run."""
COMPARE_S = 1800.0
"""Longer than it takes to compare a run's captures, even after waiting for others."""
Services = Callable[[Configuration], Awaitable[tuple[ServerConfig, SceneInfo]]]
"""Configuration and scene of the render service for a run. Raises StartError."""


@dataclass(slots=True)
class _Lease:
    page: str
    configuration: Configuration
    until: float


@dataclass(slots=True)
class _Session:
    """An experiment that pages are performing."""

    experiment: Experiment
    missing: dict[str, Configuration]
    """Incomplete runs by folder."""
    names: dict[str, str]
    made_from: dict[str, RunSources] = field(default_factory=dict)
    """Inputs and services of reserved runs, as of their reservation."""
    leases: dict[str, _Lease] = field(default_factory=dict)
    failed: set[str] = field(default_factory=set)
    """Runs that are not retried until a page starts over."""
    failures: int = 0
    """Number of consecutive failures."""
    last_problem: str | None = None
    opening: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Pages that start the experiment do so one after the other."""

    @property
    def give_up_reason(self) -> str | None:
        """Reason why the remaining runs are not tried, in one or two sentences."""
        if self.failures < GIVE_UP_AFTER:
            return None
        return (
            f"{self.failures} runs in a row failed, so the others are not tried. The last failure: {self.last_problem}"
        )

    def finish(self, run: str, problem: str | None) -> None:
        self.leases.pop(run, None)
        self.made_from.pop(run, None)
        if problem is None:
            self.missing.pop(run, None)
            self.failures = 0
        elif run not in self.failed:  # a page may report a failure that is already known
            self.failed.add(run)
            self.failures += 1
            self.last_problem = problem


async def prepare_render_service(url: str, run: Configuration) -> tuple[ServerConfig, SceneInfo]:
    """The render service at a URL, with a run's scene loaded and its download prepared. Raises StartError."""
    return await read_config(url), await load_scene(url, run.scene, download=run.mode == "local-compressed")


class Planner:
    def __init__(
        self,
        experiments: Experiments,
        workspace: Workspace,
        offload: Offload,
        *,
        movements: Path,
        render: str,
        services: Services,
        machine: Machine,
        load: Sequence[LoadSample],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._experiments = experiments
        self._workspace = workspace
        self._offload = offload
        self._movements = movements
        self._render = render.rstrip("/")
        self._services = services
        self._machine = machine
        self._load = load
        """This machine's load over the longest possible run, continuously updated."""
        self._clock = clock
        self._sessions: dict[str, _Session] = {}
        self._expanding = asyncio.Lock()
        """Files are expanded one at a time, as the largest take a gigabyte."""
        self.checks = MonitoredLock()
        """Runs are checked one at a time, as a long one takes much memory."""

    async def summary(self, body: bytes) -> PlanSummary:
        """Expand a file without storing anything. Raises InvalidRequest and TooCostly."""
        with storage_errors(), self._workspace.folder() as folder:
            try:
                experiment, _ = await self._expand(body, folder / "experiment")
            except BrokenPlan as error:
                return PlanSummary(runs=0, lasting="", problem=error.detail)
        return PlanSummary(runs=len(experiment.runs), lasting=format_duration(experiment.runs), problem=None)

    async def create(self, body: bytes) -> str:
        """Start an experiment, and return its id. Raises InvalidRequest, TooCostly and DiskFull."""
        with storage_errors(), self._workspace.folder() as folder:
            made = folder / "experiment"
            experiment, traces_s = await self._expand(body, made)
            name = await asyncio.to_thread(self._experiments.unused_name, experiment.plan.name)
            await asyncio.to_thread(experiment.write, traces_s, name)
            return await asyncio.to_thread(self._experiments.create, made, name)

    async def _expand(self, body: bytes, made: Path) -> tuple[Experiment, Mapping[str, float]]:
        async with self._expanding:
            return await self._offload(expand, body, self._movements, made, limit=LIMIT)

    async def next(self, experiment: str, asked: NextRequest) -> NextRun:
        """Reserve a run for a page.

        Raises UnknownExperiment, ExperimentInUse, InvalidRequest, CannotStart and VersionsChanged.
        """
        session = await self._session(experiment)
        async with session.opening:
            self._release(session, asked.page)
            self._drop_expired()
            if asked.begin and not session.leases:
                session.missing = await _missing_runs(session.experiment)
                session.failed, session.failures = set(), 0
                if session.missing:
                    await self._check(session, asked)
            lease = self._reserve(session, asked.page)
        job = None
        if lease is not None:
            try:
                job = await self._job(session, lease.configuration)
            except BaseException:
                self._release(session, asked.page)
                raise
        untried = session.missing.keys() - session.failed
        return NextRun(
            job=job,
            planned=len(session.experiment.runs),
            missing=len(session.missing),
            remaining_s=estimate_seconds([session.missing[run] for run in untried]),
            wait=job is None and session.give_up_reason is None and bool(untried),
            problem=session.give_up_reason,
        )

    def forget(self, experiment: str) -> None:
        """Forget a removed experiment."""
        self._sessions.pop(experiment, None)

    async def release(self, experiment: str, page: str) -> None:
        """Give up a page's runs. Raises UnknownExperiment."""
        await asyncio.to_thread(self._experiments.find, experiment)
        if (session := self._sessions.get(experiment)) is not None:
            self._release(session, page)

    def extend(self, experiment: str, run: str, seconds: float = LEASE_S) -> None:
        """Extend the reservation of a run whose page is working on it."""
        session = self._sessions.get(experiment)
        if session is not None and (lease := session.leases.get(run)) is not None:
            lease.until = max(lease.until, self._clock() + seconds)

    @contextmanager
    def count_disk_failures(self, experiment: str, run: str) -> Iterator[None]:
        """Count a run as failed if the disk refuses it, as the page could not report that either."""
        try:
            yield
        except (DiskFull, StorageFailed) as error:
            session = self._sessions.get(experiment)
            if session is not None and run in session.missing:
                session.finish(run, error.detail)
            raise

    async def add(self, experiment: str, run: str, body: Path, size: int, made: Path) -> RunRow:
        """Store a performed run from a body of `size` bytes; it is incomplete until `complete`.

        `made` is an unused path in the workspace.

        Raises UnknownExperiment, ExperimentInUse, UnknownRun, RunMade, InvalidRequest, TooCostly and DiskFull.
        """
        session = await self._session(experiment)
        configuration = self._missing(session, run)
        self.extend(experiment, run)
        made_from = session.made_from.get(run) or (await self._made_from(session, configuration))[0]
        async with self.checks:
            limit, load = check_limit(size), tuple(self._load)
            record = await self._offload(
                keep_upload, body, made, configuration, made_from, load, self._machine, limit=limit
            )
        self._missing(session, run)  # another page may have completed it meanwhile
        with storage_errors():
            try:
                await asyncio.to_thread(_place, made, session.experiment, configuration)
            except FileNotFoundError:
                raise UnknownExperiment(f"The experiment {experiment} has been removed.") from None
        if record.status == "failed":
            session.finish(run, record.problem)
        return await asyncio.to_thread(self._experiments.row, experiment, run)

    async def complete(self, experiment: str, run: str) -> RunRow:
        """Complete a run that has all its captures; a complete run is returned unchanged. Raises as `add` does."""
        session = await self._session(experiment)
        folder = await asyncio.to_thread(self._experiments.page_run, experiment, run)
        self.extend(experiment, run, COMPARE_S)
        async with self.checks:  # a page that has lost its connection asks again meanwhile
            if await asyncio.to_thread(lambda: StoredRun(folder).record.status) == "running":
                await self._offload(complete_upload, folder, self._render, limit=COMPARE)
            row = await asyncio.to_thread(self._experiments.row, experiment, run)
            if run in session.missing:
                session.finish(run, row.problem)
        return row

    async def _session(self, experiment: str) -> _Session:
        folder, record = await asyncio.to_thread(self._experiments.find_page, experiment)
        if experiment not in self._sessions:
            reopened = await self._offload(reopen, folder, record, limit=LIMIT)
            missing = await _missing_runs(reopened)
            self._sessions.setdefault(experiment, _Session(reopened, missing, run_names(reopened.runs)))
        return self._sessions[experiment]

    async def _check(self, session: _Session, asked: NextRequest) -> None:
        """Check before the first run that all runs can be made, with the same versions as existing ones."""
        missing = tuple(session.missing.values())
        scenes = {}
        try:
            for run in {(run.scene, run.mode): run for run in missing}.values():
                config, scenes[run.scene] = await self._services(run)
            check_services(missing, Target(self._render, config), scenes, session.experiment.plan.ladder)
        except StartError as error:
            raise CannotStart(str(error)) from None
        if not asked.allow_changes:
            kept = await asyncio.to_thread(session.experiment.kept_records, missing)
            now = RunVersions(self._machine.commit, None, Server.from_config(config), scenes)
            if changed := find_changes(kept, now):
                raise VersionsChanged(
                    f"Since the complete runs were made, there is another {' and another '.join(changed)}."
                )

    def _reserve(self, session: _Session, page: str) -> _Lease | None:
        """Reserve a free run. A run with a shaped link excludes all others, as pages share the link."""
        if session.give_up_reason is not None:
            return None
        self._drop_expired()
        leases = [lease for other in self._sessions.values() for lease in other.leases.values()]
        if any(lease.configuration.network.shaped for lease in leases):
            return None
        for run, configuration in session.missing.items():
            if run in session.leases or run in session.failed or (leases and configuration.network.shaped):
                continue
            until = self._clock() + configuration.warm_up_s + configuration.duration_s + LEASE_S
            session.leases[run] = _Lease(page, configuration, until)
            return session.leases[run]
        return None

    def _drop_expired(self) -> None:
        """Drop the expired leases of all experiments."""
        now = self._clock()
        for session in self._sessions.values():
            session.leases = {run: lease for run, lease in session.leases.items() if lease.until > now}

    def _release(self, session: _Session, page: str) -> None:
        session.leases = {run: lease for run, lease in session.leases.items() if lease.page != page}

    def _missing(self, session: _Session, run: str) -> Configuration:
        if (configuration := session.missing.get(run)) is not None:
            return configuration
        if run in session.names:
            raise RunMade(f"The run {run} is complete already.")
        raise UnknownRun(f"The experiment has no run {run[:100]!r}.")

    async def _job(self, session: _Session, configuration: Configuration) -> RunJob:
        session.made_from[configuration.slug], points = await self._made_from(session, configuration)
        return RunJob(
            run=configuration.slug,
            title=session.names[configuration.slug],
            configuration=configuration,
            settings=page_settings(configuration),
            plan=run_plan(configuration, points),
        )

    async def _made_from(self, session: _Session, configuration: Configuration) -> tuple[RunSources, list[TimedPose]]:
        try:
            config, scene = await self._services(configuration)
        except StartError as error:
            raise CannotStart(str(error)) from None
        points, digests = await self._offload(
            placed_points, session.experiment.inputs, configuration, scene, limit=LIMIT
        )
        return RunSources(digests, points_sha256(points), config, scene), points


async def _missing_runs(experiment: Experiment) -> dict[str, Configuration]:
    return {run.slug: run for run in await asyncio.to_thread(experiment.missing)}


def _place(made: Path, experiment: Experiment, configuration: Configuration) -> None:
    """Move a run from the workspace to its place. Raises OSError."""
    experiment.set_aside(configuration)
    made.rename(experiment.folder(configuration))
    flush_folder(experiment.out / RUNS)
