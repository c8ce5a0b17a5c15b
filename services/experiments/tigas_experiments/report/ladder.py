"""Files ladder.jpg and ladder.csv: one view of an experiment at each rung, with its size."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from tigas_common.errors import StartError
from tigas_common.pose import Pose
from tigas_common.render_requests import RenderClient
from tigas_common.wire.render import RenderRequest, Rung
from tigas_experiments.quality.picture import Picture, Quality, compare, decode, upscale_bicubic
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import LADDER, StoredRun
from tigas_experiments.report.plot import plot_style
from tigas_experiments.report.run_table import run_folders
from tigas_experiments.wire.recording import Input, Lens

PICTURE_IN = 3.2
DPI = 150
MOST_COLUMNS = 5
SAMPLES = 9
"""Views from which the shown one is chosen, as some people look at a bare wall."""
DETAIL = 4
"""Magnification of the detail below each picture."""


class Step(NamedTuple):
    """The view at one rung."""

    number: int
    rung: Rung
    width: int
    height: int
    """Frame height, pixels."""
    bytes: int
    """Size of the JPEG in bytes."""
    shown: Picture
    """The frame enlarged bicubically to the best rung's size."""
    quality: Quality
    """Quality against a lossless rendering of that size."""


async def render_ladder(renderer: RenderClient, scene: str, poses: Sequence[Pose], lens: Lens) -> list[Step]:
    """Render the most detailed view at every rung, best first, at the best rung's size and the viewport's aspect ratio.

    Detail is measured by the size of the best rung's JPEG. Raises RenderUnavailable, RenderProblem and BrokenPicture.
    """
    rungs = (await renderer.load(scene)).ladder or (await renderer.config()).ladder
    view = lens.intrinsics.resized(*rungs[0].size_for(lens.width, lens.height))
    sizes = [len(await renderer.frame(RenderRequest.at(scene, pose, view, profile=0))) for pose in poses]
    pose = poses[sizes.index(max(sizes))]
    truth = decode(await renderer.frame(RenderRequest.at(scene, pose, view, format="png")))
    found = []
    for number, rung in enumerate(rungs):
        data = await renderer.frame(RenderRequest.at(scene, pose, view, profile=number))
        frame = decode(data)
        shown = upscale_bicubic(frame, view.width, view.height)
        height, width = frame.shape[:2]
        found.append(Step(number, rung, width, height, len(data), shown, compare(shown, truth)))
    return found


def sample_views(folder: Path) -> tuple[str, list[Pose], Lens]:
    """Scene, evenly spaced poses and lens of an experiment's first run with poses. Raises StartError."""
    for run in run_folders(folder):
        try:
            stored = StoredRun(run)
            inputs = stored.read(Input)
        except BrokenRecording:
            continue
        if stored.record.recording is not None and inputs:
            chosen = inputs[:: math.ceil(len(inputs) / SAMPLES)]
            return stored.record.configuration.scene, [each.camera for each in chosen], stored.record.recording.lens
    raise StartError(f"{folder} has no run with recorded poses.")


def write_ladder(steps: Sequence[Step], folder: Path) -> list[Path]:
    """Write both files and return their paths. Raises OSError."""
    picture, table = folder / LADDER, folder / "ladder.csv"
    height, width = steps[0].shown.shape[:2]
    columns = min(len(steps), MOST_COLUMNS)
    rows = 2 * math.ceil(len(steps) / columns)
    inner = [slice((side - side // DETAIL) // 2, (side + side // DETAIL) // 2) for side in (height, width)]
    with plot_style():
        row_in = PICTURE_IN * height / width + 0.25
        figure = Figure(figsize=(PICTURE_IN * columns, row_in * rows), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False)
        for axes in panels.flat:
            axes.set_axis_off()
        for number, step in enumerate(steps):
            row, column = divmod(number, columns)
            whole, detail = panels[2 * row : 2 * row + 2, column]
            for axes, shown in ((whole, step.shown), (detail, step.shown[inner[0], inner[1]])):
                axes.imshow(shown, interpolation="antialiased")
            whole.set_title(
                f"{step.number} {step.rung.name}: {step.width}×{step.height}, q{step.rung.quality}\n"
                f"{step.bytes / 1000:,.1f} kB, {step.quality.psnr_db:.1f} dB, SSIM {step.quality.ssim:.3f}"
            )
        figure.savefig(picture, dpi=DPI, pil_kwargs={"quality": 90})
    with table.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("rung", "name", "width", "height", "jpeg_quality", "bytes", "psnr_db", "ssim"))
        for step in steps:
            size = (step.width, step.height, step.rung.quality, step.bytes)
            writer.writerow((step.number, step.rung.name, *size, step.quality.psnr_db, step.quality.ssim))
    return [picture, table]
