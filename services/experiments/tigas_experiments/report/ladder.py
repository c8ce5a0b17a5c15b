"""Files ladder.jpg and ladder.csv: one view of an experiment at each rung, with its size."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tigas_common.errors import StartError
from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import RenderRequest, Rung
from tigas_experiments.quality.picture import Picture, Quality, compare, decode, upscaled
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.report.plot import style
from tigas_experiments.report.run_table import LADDER, run_folders
from tigas_experiments.samples.renderer import Renderer
from tigas_experiments.wire.recording import Lens

PICTURE_IN = 3.2
DPI = 150
DETAIL = 4
"""Magnification of the detail below each picture."""


@dataclass(frozen=True, slots=True)
class Step:
    """The view at one rung."""

    number: int
    rung: Rung
    width: int
    height: int
    """Frame height, pixels."""
    bytes: int
    """Size of its JPEG."""
    shown: Picture
    """The frame enlarged by bicubic to the best rung's size."""
    quality: Quality
    """Quality against a lossless rendering at that size."""


async def ladder(renderer: Renderer, scene: str, pose: Pose, lens: Lens) -> list[Step]:
    """One view at every rung, best first, at the best rung's size and the viewport's aspect ratio.

    Raises RendererAway, NotRendered and BrokenPicture.
    """
    rungs = (await renderer.load(scene)).ladder or (await renderer.config()).ladder
    view = _at_best(lens.intrinsics, rungs[0])
    truth = decode(await renderer.frame(RenderRequest.at(scene, pose, view, format="png")))
    found = []
    for number, rung in enumerate(rungs):
        data = await renderer.frame(RenderRequest.at(scene, pose, view, profile=number))
        frame = decode(data)
        shown = upscaled(frame, view.width, view.height)
        height, width = frame.shape[:2]
        found.append(Step(number, rung, width, height, len(data), shown, compare(shown, truth)))
    return found


def middle_view(folder: Path) -> tuple[str, Pose, Lens]:
    """Scene, pose and lens in the middle of an experiment's first run that has poses. Raises StartError."""
    for run in run_folders(folder):
        try:
            stored = StoredRun(run)
            inputs = stored.inputs()
        except BrokenRecording:
            continue
        if stored.record.recording is not None and inputs:
            middle = inputs[len(inputs) // 2]
            return stored.record.configuration.scene, middle.camera, stored.record.recording.lens
    raise StartError(f"{folder} has no run with recorded poses.")


def write_ladder(steps: Sequence[Step], folder: Path) -> list[Path]:
    """Write both files and return their paths. Raises OSError."""
    shape = steps[0].shown.shape
    height = PICTURE_IN * shape[0] / shape[1]
    with style():
        figure = Figure(figsize=(PICTURE_IN * len(steps), 2 * height + 0.5), layout="constrained")
        panels = figure.subplots(2, len(steps), squeeze=False)
        for column, step in enumerate(steps):
            _draw(panels[0, column], step.shown)
            _draw(panels[1, column], _middle(step.shown))
            panels[0, column].set_title(_title(step))
        picture, table = folder / LADDER, folder / "ladder.csv"
        figure.savefig(picture, dpi=DPI, pil_kwargs={"quality": 90})
    with table.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("rung", "name", "width", "height", "jpeg_quality", "bytes", "psnr_db", "ssim"))
        for step in steps:
            size = (step.width, step.height, step.rung.quality, step.bytes)
            writer.writerow((step.number, step.rung.name, *size, step.quality.psnr_db, step.quality.ssim))
    return [picture, table]


def _at_best(intrinsics: Intrinsics, best: Rung) -> Intrinsics:
    return intrinsics.resized(*best.size_for(intrinsics.width, intrinsics.height))


def _title(step: Step) -> str:
    return (
        f"{step.number} {step.rung.name}: {step.width}×{step.height}, q{step.rung.quality}\n"
        f"{step.bytes / 1000:,.1f} kB, {step.quality.psnr_db:.1f} dB, SSIM {step.quality.ssim:.3f}"
    )


def _draw(axes: Axes, picture: Picture) -> None:
    axes.imshow(picture, interpolation="antialiased")
    axes.set_axis_off()


def _middle(picture: Picture) -> Picture:
    height, width = (side // DETAIL for side in picture.shape[:2])
    top, left = (picture.shape[0] - height) // 2, (picture.shape[1] - width) // 2
    return picture[top : top + height, left : left + width]
