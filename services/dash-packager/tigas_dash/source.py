"""Source of frames: the render service, or a cluster's hosts, over HTTP."""

from __future__ import annotations

import math
from dataclasses import replace

from pydantic import ValidationError

from tigas_common.errors import InvalidRequest
from tigas_common.parsing import describe_error
from tigas_common.render_requests import RenderClient, RenderUnavailable
from tigas_common.wire.dash import PoseUpdate, StreamRequest
from tigas_common.wire.render import RenderRequest, Rung
from tigas_dash.encoder import RawFrame
from tigas_dash.representation import Representation

FIRST_FRAME_S = 60
"""Timeout of the first frame in seconds, as its scene may have to be loaded."""
FRAME_S = 5
"""Seconds after which the render service counts as dead."""


async def fetch_ladder(client: RenderClient, scene: str) -> tuple[Rung, ...]:
    """The ladder to which profiles refer in a scene; empty for a missing scene, as requests for its frames report that.

    Raises RenderUnavailable.
    """
    ladders = {info.id: info.ladder for info in await client.scenes(FRAME_S)}
    return ladders.get(scene) or (await client.config(FRAME_S)).ladder


class ViewSource:
    """Views of one session, at the size from which they are encoded."""

    def __init__(self, client: RenderClient, request: StreamRequest, size: Representation) -> None:
        self.first_pose = PoseUpdate(seq=0, position=request.position, quaternion=request.quaternion)
        self._client = client
        self._scene = request.scene
        self._lens = request.intrinsics
        self._width, self._height = size.width, size.height
        self._display_scale = max(1.0, math.sqrt(request.width * request.height / size.pixels))

    async def first_frame(self) -> RawFrame:
        """The view from the first pose, once the scene is loaded. Raises as `frame` does."""
        return await self.frame(self.first_pose, FIRST_FRAME_S)

    async def frame(self, pose: PoseUpdate, within_s: float = FRAME_S) -> RawFrame:
        """The view from a pose. Raises InvalidRequest, RenderUnavailable and RenderProblem."""
        changed = {name: value for name in ("fx", "fy", "cx", "cy") if (value := getattr(pose, name)) is not None}
        lens = replace(self._lens, **changed).resized(self._width, self._height)
        try:
            request = RenderRequest.at(
                self._scene, pose.pose, lens, display_scale=self._display_scale, format="yuv420p"
            )
        except ValidationError as error:  # intrinsics valid for the viewport may be too large for the stream's size
            raise InvalidRequest(f"The stream's size does not fit the intrinsics: {describe_error(error)}") from None
        data = await self._client.frame(request, within_s)
        expected = self._width * self._height * 3 // 2
        if len(data) != expected:
            raise RenderUnavailable(f"The render service sent {len(data)} bytes for a frame of {expected}.")
        return RawFrame(data, self._width, self._height, pose.seq)
