"""Ground truth: the render service's PNG of a pose, at the viewport's resolution."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

from tigas_common.errors import TigasError
from tigas_common.render_requests import RenderClient
from tigas_common.wire.render import RenderRequest
from tigas_experiments.errors import RunFailed
from tigas_experiments.quality.picture import (
    BrokenPicture,
    CaptureQuality,
    Picture,
    Quality,
    compare,
    decode,
    decode_screen,
)
from tigas_experiments.wire.recording import Capture, Input, Lens


def find_input(inputs: Sequence[Input], pose: int) -> Input | None:
    """The input with this pose number, if there is one."""
    index = bisect_right([entry.pose for entry in inputs], pose) - 1
    return inputs[index] if index >= 0 and inputs[index].pose == pose else None


def input_at(inputs: Sequence[Input], at: float) -> Input | None:
    """The newest input at a time; None before the first input."""
    index = bisect_right([entry.at for entry in inputs], at) - 1
    return inputs[index] if index >= 0 else None


class GroundTruth:
    """Renders poses of one scene with one lens, and caches the last picture. Raises RunFailed."""

    def __init__(self, renderer: RenderClient, scene: str, lens: Lens) -> None:
        self._renderer = renderer
        self._scene = scene
        self._lens = lens
        self._last: tuple[Input, Picture] | None = None

    async def picture(self, pose: Input) -> Picture:
        if self._last is None or self._last[0] != pose:
            self._last = (pose, await self._render(pose))
        return self._last[1]

    async def assess(
        self, shown: bytes, capture: Capture, inputs: Sequence[Input], *, predicted: bool = False
    ) -> CaptureQuality | None:
        """Compare a capture with ground truth; None before the viewer's first input. Also raises BrokenPicture.

        predicted: whether frames were requested for predicted poses, which the recording lacks.
        """
        current = input_at(inputs, capture.at)
        if current is None:
            return None
        picture, uncovered = decode_screen(shown)
        as_rendered = capture.view is None and not predicted
        turned_to = input_at(inputs, capture.shown_at) if capture.view is None else find_input(inputs, capture.view)
        known: dict[Input, Quality] = {}

        async def against(pose: Input | None) -> Quality | None:
            if pose is None:
                return None
            if pose not in known:
                known[pose] = compare(picture, await self.picture(pose))
            return known[pose]

        return CaptureQuality(
            at=capture.at,
            pose=capture.pose,
            rung=capture.rung,
            picture=await against(find_input(inputs, capture.pose) if as_rendered else None),
            view=await against(turned_to),
            seen=await against(current),
            uncovered=uncovered,
        )

    async def _render(self, pose: Input) -> Picture:
        request = RenderRequest.at(self._scene, pose.camera, self._lens.intrinsics, format="png")
        try:
            return decode(await self._renderer.frame(request))
        except (TigasError, BrokenPicture) as error:
            raise RunFailed(f"Ground truth could not be rendered: {error}") from None
