"""Figures of a whole run."""

from __future__ import annotations

from tests.experiments.made_up import frame, inputs, recording, reply, sample
from tigas_experiments.quality.picture import CaptureQuality, Quality
from tigas_experiments.records.scores import Score
from tigas_experiments.records.summary import Records, figures
from tigas_experiments.report.metrics import METRICS
from tigas_experiments.wire.recording import PlayedDownload, Recording, Request


def test_a_run_with_all_records_has_every_figure() -> None:
    moved = inputs(50)
    shown = [frame(entry.at + 40, entry.pose, view=entry.pose, filled=0.1) for entry in moved]
    made = Recording.model_validate(recording(), strict=False).model_copy(
        update={
            "frames": tuple(each.model_copy(update={"warp_ms": 1.0}) for each in shown),
            "replies": tuple(reply(entry.at, 30, entry.pose) for entry in moved),
            "requests": tuple(Request(at=entry.at, pose=entry.pose, asked_rung=2, fate="shown") for entry in moved),
            "local": PlayedDownload.model_construct(began_ms=-500, first_picture_ms=1000, complete_ms=2000),
        }
    )
    good = Quality(psnr_db=30, ssim=0.9)
    compared = CaptureQuality(at=500, pose=20, rung=2, picture=good, view=good, seen=good, uncovered=0.2)
    score = Score(seq=1, picture="seen", digest="x", lpips=0.3)
    values = figures(Records(made, [sample(at) for at in (0.0, 1000.0)], [compared], [score], None)).values
    assert values.keys() == METRICS.keys()
    assert None not in values.values()
    scaled = ("frozen_s", "first_picture_s", "whole_scene_s", "received_mbit_s", "border_never_seen_pct")
    assert [values[name] for name in scaled] == [0, 0.5, 1.5, 1, 20]
