"""A page's uploaded run, from the bytes of its body to a folder of records; runs in a process with limits."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from tigas_common.errors import InvalidRequest
from tigas_common.files import to_disk
from tigas_common.offload import Limit
from tigas_common.parsing import parse
from tigas_experiments.errors import RunFailed
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import RunRecord, RunWriter, StoredRun
from tigas_experiments.records.load import LoadSample
from tigas_experiments.records.machine import Machine
from tigas_experiments.run.outcome import MadeFrom, complete, write_records
from tigas_experiments.store.errors import storage_explained
from tigas_experiments.wire.recording import MAX_BYTES
from tigas_experiments.wire.run import Configuration
from tigas_experiments.wire.store import RunUpload, mismatch

COMPARE = Limit(memory=2_000_000_000, cpu_s=1200)
"""Of comparing a run's captures with ground truth."""


def check_limit(size: int) -> Limit:
    """Resource limits of `keep_upload` for a body of `size` bytes.

    A page's run of 20 Mbit/s takes 13 times its size in memory and a quarter of a second for each megabyte.
    """
    return Limit(memory=256_000_000 + 20 * size, cpu_s=30 + 2 * size // 1_000_000)


def keep_upload(
    body: Path,
    folder: Path,
    configuration: Configuration,
    made_from: MadeFrom,
    load: Sequence[LoadSample],
    machine: Machine,
) -> RunRecord:
    """Write an uploaded run into a new folder.

    `load` is this machine's recent load. Raises InvalidRequest and DiskFull.
    """
    with storage_explained():
        upload = parse(RunUpload, body.read_bytes(), MAX_BYTES)
        recording = upload.recording
        if recording is not None and (problem := mismatch(configuration, recording)):
            raise InvalidRequest(problem)
        started = (
            datetime.now(UTC) if recording is None else datetime.fromtimestamp(recording.started_unix_ms / 1000, UTC)
        )
        record = RunRecord(
            status="running",
            problem=None,
            configuration=configuration,
            machine=machine,
            started=started.isoformat(timespec="seconds"),
        )
        browser = None if recording is None else _browser(recording.user_agent)
        record = write_records(RunWriter(folder, record), upload, load, made_from, browser=browser)
        to_disk(folder)
        return record


def complete_upload(folder: Path, render: str) -> None:
    """Complete a run that has all its captures, or mark it as failed. Raises DiskFull."""
    with storage_explained():
        try:
            asyncio.run(complete(folder, render))
        except (RunFailed, BrokenRecording) as error:
            RunWriter.resumed(StoredRun(folder)).close(status="failed", problem=str(error))


def _browser(user_agent: str) -> str | None:
    """Its version: `156.0.0.0` of Chromium, `152.0` of Firefox."""
    for name in ("Chrome/", "Firefox/", "Version/"):
        _, found, rest = user_agent.partition(name)
        if found:
            return rest.split()[0][:40] if rest.split() else None
    return None
