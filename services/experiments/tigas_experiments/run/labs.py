"""Several labs in parallel that share an experiment's blocks: much faster on a machine with many processors.

Each lab has its own network and mount namespaces, so that all can use the same names and addresses. A worker process
drives it, exchanging lines of JSON with this process.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from collections import deque
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import IO

from tigas_common.errors import StartError
from tigas_common.processes import end_with_parent, handle_sigterm_as_ctrl_c, wait_or_kill
from tigas_common.wire.model import WireModel
from tigas_experiments.records.folder import RunRecord
from tigas_experiments.run.environment import open_environment
from tigas_experiments.run.experiment import GIVE_UP_AFTER, Experiment
from tigas_experiments.run.plan import ExperimentPlan
from tigas_experiments.run.runner import RunCallbacks, make_runs, prepare
from tigas_experiments.run.targets import check_lab
from tigas_experiments.wire.run import Configuration

NAMESPACES = ("unshare", "--net", "--mount", "sh", "-ec")
SCRIPT = 'mkdir -p /run/netns; mount -t tmpfs tigas /run/netns; ip link set lo up; exec "$@"'
"""Command of a worker, in its own namespaces, that hides the other labs' network namespaces from its lab."""
START_EVERY_S = 3.0
"""Browsers that start together wait for each other in the graphics driver, which makes nearby runs stutter."""
STOP_S = 30
"""Longer than a lab takes to stop."""
MAX_ENDED = 3
"""Number of labs that may end early, as when the system runs out of memory, before the experiment is abandoned."""
LINE_BYTES = 1 << 24
"""Maximum length of a line of JSON, which holds a block of runs or the record of one."""


class LabEnded(StartError):
    """A worker ended without an answer."""


class Job(WireModel):
    """The first line sent to a worker."""

    plan: ExperimentPlan
    directory: str
    out: str
    command: str | None
    checks: tuple[str, ...] = ()
    """Folders of the runs that the first worker checks before any run is made."""
    allow_changes: bool = False


class Answer(WireModel):
    """A line from a worker; the first one, with no field set, means that its lab is ready."""

    record: RunRecord | None = None
    """Record of a finished run."""
    problem: str | None = None
    """Reason why the worker ends."""


@dataclass(frozen=True, slots=True)
class Worker:
    """The parent's side of a worker."""

    _commands: asyncio.StreamWriter
    _answers: asyncio.StreamReader
    _errors: IO[bytes]

    def send(self, line: str) -> None:
        self._commands.write(f"{line}\n".encode())

    async def receive(self) -> Answer:
        """The next line. Raises LabEnded, and StartError if the worker cannot continue."""
        line = await self._answers.readline()
        if not line:
            self._errors.seek(0)
            last = self._errors.read().decode(errors="replace").strip().splitlines()
            raise LabEnded(f"A lab ended: {last[-1] if last else 'it gave no reason'}")
        answer = Answer.model_validate_json(line)
        if answer.problem is not None:
            raise StartError(answer.problem)
        return answer


async def make_runs_in_labs(
    experiment: Experiment,
    missing: Sequence[Configuration],
    count: int,
    callbacks: RunCallbacks,
    *,
    allow_changes: bool = False,
) -> None:
    """Make an experiment's missing runs in at most `count` labs, each of which makes whole blocks.

    Raises StartError as `make_missing_runs` does.
    """
    blocks = deque(group_blocks(missing))
    job = Job(
        plan=experiment.plan,
        directory=str(experiment.inputs.directory),
        out=str(experiment.out),
        command=experiment.command,
        allow_changes=allow_changes,
    )
    first = job.model_copy(update={"checks": tuple(run.slug for run in missing)})
    checked = asyncio.Event()
    ended = 0

    async def lab(place: int) -> None:
        nonlocal ended
        if place:
            await checked.wait()
            await asyncio.sleep((place - 1) * START_EVERY_S)
        while blocks:
            try:
                async with start_worker() as worker:
                    worker.send((job if place else first).model_dump_json())
                    await worker.receive()
                    checked.set()
                    await make_blocks(worker)
            except LabEnded:
                ended += 1
                if ended == MAX_ENDED:
                    raise

    async def make_blocks(worker: Worker) -> None:
        failures = 0
        while blocks:
            block = deque(blocks.popleft())
            worker.send(json.dumps([run.slug for run in block]))
            while block:
                callbacks.on_begin(block[0])
                callbacks.on_stage("measures")
                try:
                    record = (await worker.receive()).record
                except LabEnded:
                    blocks.appendleft([*block])
                    raise
                assert record is not None
                block.popleft()
                callbacks.on_finish(record)
                failures = 0 if record.status == "complete" else failures + 1
                if failures == GIVE_UP_AFTER:
                    raise StartError(f"{failures} runs in a row failed in one lab, the last one: {record.problem}")

    await asyncio.to_thread(check_lab)
    callbacks.on_stage("starting the first lab")
    try:
        async with asyncio.TaskGroup() as labs:
            for place in range(min(count, len(blocks))):
                labs.create_task(lab(place))
    except ExceptionGroup as errors:
        raise errors.exceptions[0] from None


def group_blocks(runs: Sequence[Configuration]) -> list[list[Configuration]]:
    """Runs in their order, grouped into lists with equal inputs, which one lab makes consecutively for comparison."""
    blocks: dict[tuple[object, ...], list[Configuration]] = {}
    for run in runs:
        key = (run.scene, run.movement, run.movement_offset_s, run.network.label, run.network.offset_s, run.repeat)
        blocks.setdefault(key, []).append(run)
    return list(blocks.values())


@asynccontextmanager
async def start_worker() -> AsyncIterator[Worker]:
    """A worker process during the context. Its lab's experiment store has an empty folder."""
    with TemporaryDirectory(prefix="tigas-lab-") as results, TemporaryFile() as errors:
        process = await asyncio.create_subprocess_exec(
            *end_with_parent([*NAMESPACES, SCRIPT, "sh", sys.executable, "-m", __name__]),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=errors,
            start_new_session=True,
            limit=LINE_BYTES,
            env={**os.environ, "TIGAS_STORE_RESULTS": results},
        )
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            yield Worker(process.stdin, process.stdout, errors)
        except BaseException:
            if process.returncode is None:
                process.terminate()
            raise
        finally:
            process.stdin.close()
            await wait_or_kill(process, STOP_S)


def main() -> None:
    """Run a worker, with blocks on standard input and answers on standard output."""
    handle_sigterm_as_ctrl_c()
    job = Job.model_validate_json(sys.stdin.readline())
    try:
        asyncio.run(_work(job))
    except StartError as error:
        _send(Answer(problem=str(error)))


async def _work(job: Job) -> None:
    experiment = Experiment.from_plan(job.plan, Path(job.directory), Path(job.out), job.command)
    runs = {run.slug: run for run in experiment.runs}
    callbacks = RunCallbacks(lambda _: None, lambda _: None, lambda record: _send(Answer(record=record)))
    webgpu = any(run.enhanced for run in experiment.runs)
    async with open_environment(None, experiment.inputs, ladder=job.plan.ladder, webgpu=webgpu) as environment:
        if job.checks:
            to_check = [runs[slug] for slug in job.checks]
            await prepare(experiment, to_check, environment, allow_changes=job.allow_changes)
        _send(Answer())
        while line := await asyncio.to_thread(sys.stdin.readline):
            await make_runs(experiment, [runs[slug] for slug in json.loads(line)], environment, callbacks)


def _send(answer: Answer) -> None:
    print(answer.model_dump_json(), flush=True)


if __name__ == "__main__":
    main()
