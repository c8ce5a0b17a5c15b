"""Trains a scene's networks in a child process of low priority, which requests its training data like any client.

Only one training runs at a time, because it occupies a processor or the GPU for a minute. The child writes its file
atomically at the end, so stopping it leaves the scene unchanged.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
from asyncio.subprocess import PIPE, Process
from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from tigas_common.errors import TigasError
from tigas_common.installation import install_command
from tigas_common.processes import tigas_command, wait_or_kill
from tigas_common.wire.render import Training

NICENESS = 15
STOP_TIMEOUT_S = 5.0
"""Seconds after which a child that has been asked to exit is killed."""
MAX_OUTPUT_BYTES = 4096
"""Maximum number of bytes in a line of progress, and of a child's standard error to keep."""

_log = logging.getLogger(__name__)


class TrainingUnavailable(TigasError):
    """The dependencies of training are not installed."""

    status, type, title = 501, "no-training", "Networks cannot be trained here"


class TrainingRunning(TigasError):
    """Another training is running already."""

    status, type, title = 409, "training-runs", "Networks are being trained"


def training_problem() -> str | None:
    """Why networks cannot be trained here, in one sentence; None if they can."""
    if find_spec("torch"):
        return None
    return f"Training needs PyTorch, which this server does not have: {install_command('lab')}, or the GPU image."


def training_command(scene_id: str, out: Path, url: str, device: str) -> list[str]:
    """The command line that trains a scene's networks."""
    where = ["--render", url, "--out", str(out), "--device", device]
    return tigas_command("enhance", "train", "--json", *where, "--", scene_id)


class Trainer:
    """The running training, and the result of each scene's last training. device: the device to train on."""

    def __init__(self, device: str, command: Callable[[str, Path, str, str], list[str]] = training_command) -> None:
        self._device = device
        self._command = command
        self._states: dict[str, Training] = {}
        self._running: tuple[str, asyncio.Task[Training]] | None = None

    def state(self, scene_id: str) -> Training:
        """Progress of a scene's training, or the result of its last training."""
        return self._states.get(scene_id, Training(state="idle"))

    def start(self, scene_id: str, out: Path, url: str) -> Training:
        """Train a scene's networks on views rendered by the service at this URL. Raises TrainingRunning."""
        if self._running is not None:
            raise TrainingRunning(f"The networks of {self._running[0]} are being trained; wait, or stop the training.")
        self._states[scene_id] = Training(state="running", stage="starting")
        task = asyncio.create_task(self._run(scene_id, self._command(scene_id, out, url, self._device)))
        task.add_done_callback(lambda task: self._record_outcome(scene_id, task))
        self._running = scene_id, task
        return self.state(scene_id)

    async def stop(self, scene_id: str) -> Training:
        """Stop a scene's training, if it is running, and wait until it has ended."""
        if self._running is not None and self._running[0] == scene_id:
            await self.close()
        return self.state(scene_id)

    async def close(self) -> None:
        """Stop the running training, if any."""
        if self._running is not None:
            task = self._running[1]
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    def _record_outcome(self, scene_id: str, task: asyncio.Task[Training]) -> None:
        outcome = Training(state="idle") if task.cancelled() else task.result()
        self._states[scene_id], self._running = outcome, None
        _log.info("The training of %s ended: %s", scene_id, outcome.problem or outcome.state)

    async def _run(self, scene_id: str, argv: list[str]) -> Training:
        _log.info("Training the networks of %s", scene_id)
        try:
            return await self._train(scene_id, argv)
        except OSError as error:
            return Training(state="failed", problem=f"The training could not be started: {error.strerror or error}.")
        except Exception:
            _log.exception("The training of %s failed", scene_id)
            return Training(state="failed", problem="The training failed; the server's log says why.")

    async def _train(self, scene_id: str, argv: list[str]) -> Training:
        process = await asyncio.create_subprocess_exec(*argv, stdout=PIPE, stderr=PIPE, limit=MAX_OUTPUT_BYTES)
        try:
            with suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, process.pid, NICENESS)
            _, stderr = await asyncio.gather(self._read_progress(scene_id, process), _read_stderr(process))
            status = await process.wait()
        finally:
            await _terminate(process)
        if status == 0:
            return Training(state="done", progress=1)
        lines = [line.strip() for line in stderr.splitlines() if line.strip()]
        return Training(state="failed", problem=lines[-1] if lines else f"The training ended with status {status}.")

    async def _read_progress(self, scene_id: str, process: Process) -> None:
        assert process.stdout is not None
        async for line in process.stdout:
            update = json.loads(line)
            self._states[scene_id] = Training(state="running", progress=update["progress"], stage=update["stage"])


async def _read_stderr(process: Process) -> str:
    """The end of a child's standard error."""
    assert process.stderr is not None
    kept = b""
    while part := await process.stderr.read(MAX_OUTPUT_BYTES):
        kept = (kept + part)[-MAX_OUTPUT_BYTES:]
    return kept.decode(errors="replace")


async def _terminate(process: Process) -> None:
    if process.returncode is not None:
        return
    with suppress(ProcessLookupError):
        process.terminate()
    await wait_or_kill(process, STOP_TIMEOUT_S)
