"""A run that a page uploads, from the bytes of its body to a folder of records."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from tigas_common.files import to_disk
from tigas_common.offload import Limit
from tigas_common.parsing import parse
from tigas_experiments.records.folder import RunRecord, RunWriter
from tigas_experiments.records.load import Load, LoadSample
from tigas_experiments.records.machine import Machine
from tigas_experiments.records.summary import Records, Summary, figures
from tigas_experiments.store.errors import storage_explained
from tigas_experiments.wire.recording import MAX_BYTES
from tigas_experiments.wire.store import InterruptedRun, RunUpload


def check_limit(size: int) -> Limit:
    """Resource limits of `keep_upload` for a body of `size` bytes.

    A page's run of 20 Mbit/s takes 13 times its size in memory and a quarter of a second for each megabyte.
    """
    return Limit(memory=256_000_000 + 20 * size, cpu_s=30 + 2 * size // 1_000_000)


def keep_upload(body: Path, folder: Path, load: Sequence[LoadSample], machine: Machine) -> Summary:
    """Write an uploaded run into a new folder, and return its summary.

    `load` is this machine's recent load. Raises InvalidRequest and DiskFull.
    """
    with storage_explained():
        upload = parse(RunUpload, body.read_bytes(), MAX_BYTES)
        record = write_run(folder, upload, load, machine)
        to_disk(folder)
    if record.status != "complete":
        return Summary(folder=folder.name, record=record, figures=None, problem=record.problem)
    records = Records.of_recording(upload.recording, upload.link)
    return Summary(folder=folder.name, record=record, figures=figures(records), problem=None)


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
        record = RunWriter(folder, record).close(
            status="failed", problem="The page was closed before the run's end; only its samples are left."
        )
        to_disk(folder)
    return Summary(folder=folder.name, record=record, figures=None, problem=record.problem)


def write_run(folder: Path, upload: RunUpload, load: Sequence[LoadSample], machine: Machine) -> RunRecord:
    """Write a page's run into a new folder, with the part of `load` during the run. Raises OSError."""
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
    return writer.close(
        status="complete" if recording.complete else "failed",
        problem=None if recording.complete else "The movement was not played to its end.",
        load=Load.of(during),
        recording=recording.head,
    )
