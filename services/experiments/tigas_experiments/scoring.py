"""Computes the requested metrics for a run's samples and captures; existing scores are reused."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from pathlib import Path

from tigas_experiments.quality.metrics import VIDEO, Meters, Name
from tigas_experiments.quality.picture import BrokenPicture, Picture
from tigas_experiments.quality.vmaf import vmaf_and_vif
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.samples import read_samples
from tigas_experiments.records.scores import (
    KINDS,
    Contents,
    Kind,
    Score,
    Triplet,
    Values,
    read_scores,
    triplets,
    write_scores,
)
from tigas_experiments.wire.recording import Sample

MAX_VIDEO_FRAMES = 240
"""Maximum number of frames in a VMAF video, which limits the loss after an interruption."""
SAVE_EVERY_S = 5.0
OnProgress = Callable[[int], None]
"""Progress callback: number of additional steps done."""


class Scoring:
    def __init__(
        self, run: Path, meters: Meters, on_progress: OnProgress = lambda steps: None, *, again: bool = False
    ) -> None:
        """again: whether to replace scores of the metrics in `meters`. Raises BrokenRecording and OSError."""
        self.triplets = triplets(run)
        self.problems: dict[str, str] = {}
        """Reasons for missing scores, by name of the picture."""
        self._run = run
        self._meters = meters
        self._on_progress = on_progress
        self._models = {sample.seq: _model(sample) for sample in read_samples(run)}
        self._scores = _read_earlier(run, even_broken=again)
        self._again = again
        self._saved = time.monotonic()

    @property
    def steps(self) -> int:
        return len(self.triplets) * (bool(self._meters.single) + self._meters.video)

    def score(self) -> list[Score]:
        """Compute and write all scores; those of a run without pictures are kept. Raises StartError and OSError."""
        if not self.triplets:
            return list(self._scores.values())
        try:
            for start in range(0, len(self.triplets), MAX_VIDEO_FRAMES):
                batch = self.triplets[start : start + MAX_VIDEO_FRAMES]
                for triplet in batch:
                    self._score_single(triplet)
                if self._meters.video:
                    for kind in KINDS:
                        self._score_video(kind, [each for each in batch if kind in each.pictures])
                    self._on_progress(len(batch))
            sound = [each for each in self.triplets if each.name not in self.problems]
            there = {(each.seq, kind) for each in sound for kind in each.pictures}
            self._scores = {key: score for key, score in self._scores.items() if key in there}
        finally:  # saves scores after Ctrl+C as well
            write_scores(self._run, self._scores.values())
        return list(self._scores.values())

    def _score_single(self, triplet: Triplet) -> None:
        """Compute metrics of single pictures, and drop earlier scores of changed files."""
        try:
            contents = triplet.read()
            for kind in triplet.pictures:
                self._ensure_score(triplet.seq, kind, contents)
            pending = [
                (meter, kinds)
                for meter in self._meters.single
                if (kinds := [kind for kind in triplet.pictures if self._lacks((triplet.seq, kind), meter.names)])
            ]
            if pending:
                truth, pictures = contents.decode()
                for meter, kinds in pending:
                    measured = meter.measure([pictures[kind] for kind in kinds], truth)
                    for kind, values in zip(kinds, measured, strict=True):
                        self._add(triplet.seq, kind, dict(zip(meter.names, values, strict=True)))
        except (BrokenRecording, BrokenPicture) as error:
            self.problems[triplet.name] = str(error)
        if self._meters.single:
            self._on_progress(1)
        if time.monotonic() - self._saved > SAVE_EVERY_S:
            write_scores(self._run, self._scores.values())
            self._saved = time.monotonic()

    def _score_video(self, kind: Kind, batch: Sequence[Triplet]) -> None:
        """Compute VMAF and VIFp of all samples in the batch, unless all of them have scores."""
        if not any(each.name not in self.problems and self._lacks((each.seq, kind), VIDEO) for each in batch):
            return
        frames = self._decoded(kind, batch)
        for _, group in groupby(frames, key=lambda frame: frame[2].shape):
            for seq, values in vmaf_and_vif(group).items():
                self._add(seq, kind, dict(zip(VIDEO, values, strict=True)))

    def _decoded(self, kind: Kind, batch: Sequence[Triplet]) -> Iterator[tuple[int, Picture, Picture]]:
        """Yield (seq, picture, truth), leaving out pictures that cannot be compared."""
        for triplet in batch:
            if triplet.name not in self.problems:
                try:
                    truth, pictures = triplet.read().decode()
                except (BrokenRecording, BrokenPicture) as error:
                    self.problems[triplet.name] = str(error)
                else:
                    yield triplet.seq, pictures[kind], truth

    def _ensure_score(self, seq: int, kind: Kind, contents: Contents) -> None:
        """Add an empty score, unless there already is one of the same pictures."""
        digest, model = contents.digest(kind), self._models.get(seq) if kind == "enhanced" else None
        known = self._scores.get((seq, kind))
        if known is None or known.digest != digest or known.model != model:
            self._scores[seq, kind] = Score(seq=seq, picture=kind, digest=digest, model=model)

    def _lacks(self, key: tuple[int, Kind], metrics: Sequence[Name]) -> bool:
        return self._again or not self._scores[key].has(metrics)

    def _add(self, seq: int, kind: Kind, values: Values) -> None:
        self._scores[seq, kind] = self._scores[seq, kind].model_copy(update=dict(values.items()))


def _read_earlier(run: Path, *, even_broken: bool) -> dict[tuple[int, Kind], Score]:
    """Scores by sample and picture; empty if they are broken. Raises BrokenRecording unless `even_broken`."""
    try:
        return {score.key: score for score in read_scores(run)}
    except BrokenRecording:
        if even_broken:
            return {}
        raise


def _model(sample: Sample) -> str | None:
    """Enhancement models, such as `anime4k-restore-m + scene`; None without enhancement."""
    return " + ".join(name for name in (sample.restore, sample.upscale) if name != "off") or None
