"""The error of late frames, fitted to captures that follow a known law."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.seen_error import captures, errors, fitted, late_errors, of_folders

RUNGS = np.array([(24.0, 0.8), (32.0, 0.92), (42.0, 0.98)])
LAW = np.array([0.8, 30.0, 1.5, 0.9, 0.06, 0.8])


def write_run(folder: Path, **configuration: object) -> None:
    """A run with ten degrees of turn from input to input, and a capture of each frame two inputs late."""
    folder.mkdir(parents=True)
    made = {"mode": "stateless", "reprojection": True, "prediction": "linear", **configuration}
    ladder = [{"psnr_db": 32.0}]
    (folder / "run.json").write_text(
        json.dumps({"status": "complete", "configuration": made, "server": {"ladder": ladder}})
    )
    half = [math.radians(5 * number) for number in range(4)]
    inputs = [
        {"at": 100 * n, "pose": n, "quaternion": [0, math.sin(angle), 0, math.cos(angle)]}
        for n, angle in enumerate(half)
    ]
    quality = [{"at": 100 * n + 250, "pose": n, "rung": 0, "seen": {"psnr_db": 30.0, "ssim": 0.9}} for n in range(2)]
    quality.append({"at": 50, "pose": 0, "rung": 0, "seen": None})
    for name, lines in (("inputs", inputs), ("quality", quality)):
        (folder / f"{name}.ndjson").write_text("\n".join(json.dumps(line) for line in lines))


def test_a_capture_has_the_angle_that_the_viewer_turned_since_the_pose_of_its_frame(tmp_path: Path) -> None:
    write_run(tmp_path / "run")
    found = list(captures(tmp_path / "run"))
    assert [one[1:] for one in found] == [(32.0, 30.0, 0.9)] * 2
    assert [one[0] for one in found] == pytest.approx([20, 20])


def test_only_predicted_and_reprojected_frames_count(tmp_path: Path) -> None:
    others: list[dict[str, object]] = [{"mode": "video"}, {"reprojection": False}, {"prediction": "off"}]
    for number, other in enumerate(others):
        write_run(tmp_path / "runs" / str(number), **other)
    with pytest.raises(SystemExit, match="No run has captures"):
        of_folders([tmp_path])
    write_run(tmp_path / "runs" / "good")
    assert of_folders([tmp_path]).shape == (2, 4)


def test_the_law_is_found_again() -> None:
    turns, psnr = (each.ravel() for each in np.meshgrid(np.geomspace(0.5, 60, 30), (24.0, 28.0, 32.0, 42.0)))
    mse, loss = errors(late_errors(LAW, turns), psnr, RUNGS, (LAW[0], LAW[3]))
    found = np.stack([turns, psnr, 10 * np.log10(255**2 / mse), 1 - loss], axis=1)
    assert fitted(found, RUNGS) == pytest.approx(LAW, rel=0.02)
