"""A run that was uploaded, from the text of its body to a folder of records."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from tigas_common.errors import InvalidRequest
from tigas_common.parsing import sentence
from tigas_common.wire.store import RunUpload
from tigas_experiments.records.folder import RunRecord, RunWriter
from tigas_experiments.records.load import Load, LoadSample
from tigas_experiments.records.machine import Machine
from tigas_experiments.records.summary import Summary, summarise
from tigas_experiments.store.errors import storage_explained
from tigas_experiments.store.workspace import to_disk

Model = TypeVar("Model", bound=BaseModel)


def take_in(body: Path, folder: Path, load: Sequence[LoadSample], machine: Machine) -> Summary:
    """Write the run that `body` tells of into a new folder, and read from there what is to be said of it.

    `load` is that of this machine, as far as it is remembered. Raises InvalidRequest and DiskFull.
    """
    with storage_explained():
        write_run(folder, parsed(RunUpload, body.read_bytes()), load, machine)
        to_disk(folder)
    return summarise(folder)


def parsed(model: type[Model], body: bytes) -> Model:
    """What was sent. Raises InvalidRequest naming the first field that is wrong."""
    try:
        return model.model_validate_json(body)
    except ValidationError as error:
        raise InvalidRequest(sentence(error)) from None


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
    )
    writer = RunWriter(folder, record)
    writer.recording(recording)
    writer.surroundings(upload.link, during)
    writer.quality(())
    writer.close(
        status="complete" if recording.complete else "failed",
        problem=None if recording.complete else "The movement was not played to its end.",
        load=Load.of(during),
        recording=recording.head,
    )
