"""The samples of a run, as the page shows them: which there are, and their pictures."""

from __future__ import annotations

import re
from pathlib import Path

from tigas_common.files import read_regular
from tigas_common.wire.store import SampleCounts, SampleList, SampleRow
from tigas_experiments.records.materialised import REPLAYED, TRUTH, sampled_run
from tigas_experiments.records.samples import ENHANCED, JPEG, MAX_PICTURE_BYTES, sample_path
from tigas_experiments.store.errors import UnknownSample

MEDIA_TYPES = {".jpg": "image/jpeg", ".png": "image/png", ".webp": "image/webp"}
NAME = re.compile(f"[0-9]{{6,10}}[.]({'|'.join(map(re.escape, (JPEG, *ENHANCED, REPLAYED, TRUTH)))})")


def list_samples(run: Path) -> SampleList:
    """Those of a run's folder, in the order of time."""
    found = sampled_run(run)
    rows = []
    for sample in sorted(found.samples, key=lambda sample: sample.at):
        known = found.known.get(sample.seq)

        def named(*kinds: str, seq: int = sample.seq) -> str | None:
            paths = (sample_path(run, seq, kind) for kind in kinds)
            return next((path.name for path in paths if path.is_file() and not path.is_symlink()), None)

        rows.append(
            SampleRow(
                seq=sample.seq,
                at=sample.at,
                rung=sample.rung,
                bytes=sample.bytes,
                width=sample.width,
                height=sample.height,
                restore=sample.restore,
                upscale=sample.upscale,
                enhance_ms=sample.enhance_ms,
                original=named(JPEG),
                enhanced=named(*ENHANCED),
                truth=named(TRUTH),
                replayed=named(REPLAYED),
                identical=None if known is None else known.identical,
                problem=None if known is None else known.problem,
            )
        )
    return SampleList(samples=tuple(rows), problem=found.problem)


def picture(run: Path, name: str) -> tuple[bytes, str]:
    """A picture and its media type; a link is none. Raises UnknownSample."""
    if not NAME.fullmatch(name) or (run / "samples").is_symlink():  # as a path it could lead anywhere
        raise UnknownSample(f"No sample has a picture {name[:100]!r}.")
    try:
        data = read_regular(run / "samples" / name, MAX_PICTURE_BYTES, follow=False)
    except OSError:
        raise UnknownSample(f"The run has no picture {name}.") from None
    return data, MEDIA_TYPES[Path(name).suffix]


def count_samples(run: Path) -> SampleCounts | None:
    """None of a run without samples."""
    found = sampled_run(run)
    if not found.samples:
        return None
    return SampleCounts(
        samples=len(found.samples), identical=found.identical, different=found.different, missing=found.missing
    )
