"""Samples of runs over HTTP: lists, pictures, and uploads picture by picture.

After an interruption, a page uploads only missing pictures. Without an index, a run has no samples. All functions
block.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from tigas_common.errors import BodyTooLarge, InvalidRequest, StorageFailed
from tigas_common.files import flush_folder, flush_tree, read_regular
from tigas_experiments.records.folder import StoredRun, capture_path
from tigas_experiments.records.samples import (
    ENHANCED,
    FOLDER,
    INDEX,
    JPEG,
    MAX_PICTURE_BYTES,
    REPLAYED,
    TRUTH,
    read_sampled_run,
    sample_path,
    write_samples,
)
from tigas_experiments.run.parsing import MOST_PICTURES
from tigas_experiments.store.errors import RunMade, SamplesComplete, UnknownSample
from tigas_experiments.wire.recording import Sample
from tigas_experiments.wire.store import (
    MOST_SAMPLES,
    SampleCounts,
    SampleIndex,
    SampleList,
    SampleRow,
    UploadedFile,
    UploadedSamples,
)

MEDIA_TYPES = {".jpg": "image/jpeg", ".png": "image/png", ".webp": "image/webp"}
NUMBER = "[0-9]{6,10}[.]"
UPLOADED = re.compile(f"{NUMBER}({'|'.join(map(re.escape, (JPEG, *ENHANCED)))})")
CAPTURE = re.compile("[0-9]{4}[.]png")
SERVED = re.compile(f"{NUMBER}({'|'.join(map(re.escape, (JPEG, *ENHANCED, REPLAYED, TRUTH)))})")
MAX_INDEX_BYTES = 16_000_000
MAX_RUN_BYTES = 8_000_000_000
"""Maximum size of all pictures of a run."""
MOST_FILES = 2 * MOST_SAMPLES


def list_samples(run: Path) -> SampleList:
    """The samples in a run's folder, by display time."""
    found = read_sampled_run(run)
    rows = []
    for sample in sorted(found.samples, key=lambda sample: sample.at):
        known = found.known.get(sample.seq)

        def named(*kinds: str, seq: int = sample.seq) -> str | None:
            paths = (sample_path(run, seq, kind) for kind in kinds)
            return next((path.name for path in paths if path.is_file() and not path.is_symlink()), None)

        shared = sample.model_dump(include=set(SampleRow.model_fields) - {"enhanced"})
        rows.append(
            SampleRow(
                **shared,
                original=named(JPEG),
                enhanced=named(*ENHANCED),
                truth=named(TRUTH),
                replayed=named(REPLAYED),
                identical=None if known is None else known.identical,
                problem=None if known is None else known.problem,
            )
        )
    return SampleList(samples=tuple(rows), problem=found.problem)


def read_picture(run: Path, name: str) -> tuple[bytes, str]:
    """A picture and its media type, without following links. Raises UnknownSample."""
    if not SERVED.fullmatch(name) or (run / "samples").is_symlink():  # a path could lead anywhere
        raise UnknownSample(f"No sample has a picture {name[:100]!r}.")
    try:
        data = read_regular(run / "samples" / name, MAX_PICTURE_BYTES, follow=False)
    except OSError:
        raise UnknownSample(f"The run has no picture {name}.") from None
    return data, MEDIA_TYPES[Path(name).suffix]


def count_samples(run: Path) -> SampleCounts | None:
    """Counts of a run's samples; None without samples."""
    found = read_sampled_run(run)
    if not found.samples:
        return None
    return SampleCounts(
        samples=len(found.samples), identical=found.identical, different=found.different, missing=found.missing
    )


def list_uploaded(run: Path) -> UploadedSamples:
    """The uploaded samples of a run. Raises StorageFailed."""
    return UploadedSamples(
        complete=(run / INDEX).exists(),
        files=tuple(UploadedFile(name=name, bytes=size) for name, size in sorted(_files(run).items())),
    )


def check_upload(run: Path, name: str) -> None:
    """Check that another picture is allowed. Raises InvalidRequest, SamplesComplete, BodyTooLarge and StorageFailed."""
    if not UPLOADED.fullmatch(name):
        raise InvalidRequest(f"{name[:60]!r} is not an image of a sample, such as 000123.jpg.")
    if (run / INDEX).exists():
        raise SamplesComplete(f"The samples of the run {run.name} are complete.")
    files = _files(run)
    if name not in files and len(files) >= MOST_FILES:
        raise BodyTooLarge(f"A run has at most {MOST_SAMPLES:,} samples.")
    if sum(files.values()) > MAX_RUN_BYTES:
        raise BodyTooLarge(f"The samples of a run have at most {MAX_RUN_BYTES:,} bytes.")


def keep_picture(part: Path, run: Path) -> None:
    """Move a picture, which already has its name, to its run. Raises as `check_upload` does, and OSError."""
    check_upload(run, part.name)
    if not _is_complete_image(part):
        raise InvalidRequest(f"{part.name} is not such an image, or is incomplete.")
    (run / FOLDER).mkdir(exist_ok=True)
    flush_tree(part.parent)
    part.replace(run / FOLDER / part.name)
    flush_folder(run / FOLDER)


def keep_capture(part: Path, run: Path) -> None:
    """Move a capture, which already has its name, to its run. Raises InvalidRequest, RunMade and OSError."""
    if not CAPTURE.fullmatch(part.name) or int(part.stem) >= MOST_PICTURES:
        raise InvalidRequest(
            f"{part.name[:60]!r} is not a capture, such as 0012.png; a run has at most {MOST_PICTURES}."
        )
    if StoredRun(run).record.status != "running":
        raise RunMade(f"The run {run.name} has ended.")
    if not _is_complete_image(part):
        raise InvalidRequest(f"{part.name} is not a PNG, or is incomplete.")
    part.replace(capture_path(run, int(part.stem)))


def keep_index(index: SampleIndex, workspace: Path, run: Path) -> None:
    """Complete a run's samples. Raises InvalidRequest, SamplesComplete and OSError."""
    if (run / INDEX).exists():
        raise SamplesComplete(f"The samples of the run {run.name} are complete.")
    if len({sample.seq for sample in index.samples}) < len(index.samples):
        raise InvalidRequest("Two samples have the same sequence number.")
    files = _files(run)
    for sample in index.samples:
        if (missing := _missing(sample, files)) is not None:
            raise InvalidRequest(f"{missing} is missing.")
    write_samples(workspace, index.samples)
    flush_tree(workspace)
    (workspace / INDEX).replace(run / INDEX)
    flush_folder(run)


def _missing(sample: Sample, files: dict[str, int]) -> str | None:
    number = f"{sample.seq:06}"
    if files.get(f"{number}.{JPEG}") != sample.bytes:
        return f"{number}.{JPEG} of {sample.bytes} bytes"
    if sample.enhanced and not any(f"{number}.{kind}" in files for kind in ENHANCED):
        return f"{number}.{ENHANCED[0]}"
    return None


def _files(run: Path) -> dict[str, int]:
    """Sizes of pictures by name, without links and unknown names."""
    folder = run / FOLDER
    if folder.is_symlink():
        raise StorageFailed(f"The run {run.name} has a link in place of its samples.")
    if not folder.is_dir():
        return {}
    with os.scandir(folder) as entries:
        return {
            entry.name: entry.stat(follow_symlinks=False).st_size
            for entry in entries
            if UPLOADED.fullmatch(entry.name) and entry.is_file(follow_symlinks=False)
        }


def _is_complete_image(path: Path) -> bool:
    """Whether a file begins and ends like a picture of its type."""
    data = path.read_bytes()
    if path.suffix == ".jpg":
        return data[:3] == b"\xff\xd8\xff" and data[-2:] == b"\xff\xd9"
    if path.suffix == ".png":
        return data[:8] == b"\x89PNG\r\n\x1a\n" and data[-8:-4] == b"IEND"
    return data[:4] == b"RIFF" and data[8:12] == b"WEBP" and int.from_bytes(data[4:8], "little") + 8 == len(data)
