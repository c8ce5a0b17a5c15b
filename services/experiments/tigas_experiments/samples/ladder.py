"""The quality ladder of a scene, as one view at each of its rungs."""

from __future__ import annotations

from dataclasses import dataclass

from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.recording import Lens
from tigas_common.wire.render import RenderRequest, Rung
from tigas_experiments.quality.picture import Picture, Quality, compare, decode, upscaled
from tigas_experiments.samples.renderer import Renderer


@dataclass(frozen=True, slots=True)
class Step:
    """The view at one rung."""

    number: int
    rung: Rung
    width: int
    height: int
    """Of the frame, pixels."""
    bytes: int
    """Of its JPEG."""
    shown: Picture
    """Enlarged by bicubic to the best rung's size."""
    quality: Quality
    """Against the view without loss, at that size."""


async def ladder(renderer: Renderer, scene: str, pose: Pose, lens: Lens) -> list[Step]:
    """One view at every rung, from the best.

    It is shown at the best rung's size, in the viewport's shape. Raises RendererAway, NotRendered and BrokenPicture.
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


def _at_best(intrinsics: Intrinsics, best: Rung) -> Intrinsics:
    return intrinsics.resized(*best.size_for(intrinsics.width, intrinsics.height))
