"""A run that a page uploads, from the bytes of its body to a folder of records."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from tigas_common.parsing import parse
from tigas_common.wire.recording import MAX_BYTES
from tigas_common.wire.store import InterruptedRun, RunUpload
from tigas_common.work_limits import Limit
from tigas_experiments.records.folder import RunRecord, RunWriter
from tigas_experiments.records.load import Load, LoadSample
from tigas_experiments.records.machine import Machine
from tigas_experiments.records.summary import Summary, summarise
from tigas_experiments.store.errors import storage_explained
from tigas_experiments.store.workspace import to_disk


def check_limit(size: int) -> Limit:
    """What `keep_upload` may take for a body of so many bytes.

    A page's run of 20 Mbit/s takes 13 times its size in memory and a quarter of a second for each megabyte.
    """
    return Limit(memory=256_000_000 + 20 * size, cpu_s=30 + 2 * size // 1_000_000)


def keep_upload(body: Path, folder: Path, load: Sequence[LoadSample], machine: Machine) -> Summary:
    """Write the run that `body` tells of into a new folder, and read from there what is to be said of it.

    `load` is that of this machine, as far as it is remembered. Raises InvalidRequest and DiskFull.
    """
    with storage_explained():
        write_run(folder, parse(RunUpload, body.read_bytes(), MAX_BYTES), load, machine)
        to_disk(folder)
    return summarise(folder)


def keep_interrupted(folder: Path, interrupted: InterruptedRun, machine: Machine) -> Summary:
    """Write a run of which there are only samples into a new folder. Raises DiskFull."""
    with storage_explained():
        record = RunRecord(
            status="running",
            problem=None,
            configuration=interrupted.configuration,
            machine=machine,
            started=datetime.fromtimestamp(interrupted.started_unix_ms / 1000, UTC).isoformat(timespec="seconds"),
        )
        RunWriter(folder, record).close(
            status="failed", problem="The page was closed before the run's end; only its samples are left."
        )
        to_disk(folder)
    return summarise(folder)


def write_run(folder: Path, upload: RunUpload, load: Sequence[LoadSample], machine: Machine) -> None:
    """Write a page's run into a new folder; of `load`, what was during it. Raises OSError."""
    recording = upload.recording
    start = recording.started_unix_ms
    during = [sample for sample in load if 0 <= sample.unix_ms - start <= recording.ended_ms]
    record = RunRecord(
        status="running",
        problem=None,
        configuration=upload.configuration,
        machine=machine,
        started=datetime.fromtimestamp(start / 1000, UTC).isoformat(timespec="seconds"),
        scene_bytes=upload.scene_bytes,
        scene_sha256=upload.scene_sha256,
        backend=upload.backend,
    )
    writer = RunWriter(folder, record)
    writer.recording(recording)
    writer.link_and_load(upload.link, during)
    writer.quality(())
    writer.close(
        status="complete" if recording.complete else "failed",
        problem=None if recording.complete else "The movement was not played to its end.",
        load=Load.of(during),
        recording=recording.head,
    )
