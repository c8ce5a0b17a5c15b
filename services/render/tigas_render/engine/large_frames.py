"""Frames too large to be rendered while other clients are active: a started frame is never interrupted."""

from __future__ import annotations

from collections import OrderedDict

from tigas_common.errors import Overloaded
from tigas_common.wire.render import RenderRequest, Rung
from tigas_render.engine.cost_model import CostModel
from tigas_render.engine.frame_size import FrameSize
from tigas_render.frame import Client

ACTIVE_S = 2.0
"""Seconds for which a client counts as active after a request or a frame."""
USUAL_OVERSCAN = 0.25
"""A rung with at most this overscan is a display's normal need: the page requests no more by itself."""
SHORT_S = 0.05
"""Acceptable wait for another client's frame of any size, in seconds."""


class Admission:
    """Refuses frames above the server's best rung that would take long, as long as another client is active."""

    def __init__(self, ladder: tuple[Rung, ...], costs: CostModel) -> None:
        self._costs = costs
        self._best = max(rung.width * rung.height for rung in ladder)
        self._active: OrderedDict[Client, float] = OrderedDict()
        """Last activity of each client, oldest first."""

    def heard_of(self, client: Client, now: float) -> None:
        """Record a client's request, or the start of its frame."""
        self._active[client] = now
        self._active.move_to_end(client)
        self._forget(now)

    def check(self, client: Client, request: RenderRequest, size: FrameSize, now: float, *, others_wait: bool) -> None:
        """Raises Overloaded, with a retry time, if a request must wait until no other client is active."""
        is_usual = request.profile is not None and request.overscan <= USUAL_OVERSCAN
        if is_usual or size.pixels <= self._best or not (others_wait or self._others(client, now)):
            return
        usual = self._costs.at_least(request.scene, request.format, self._best)
        if self._costs.at_most(request.scene, request.format, size.pixels) > max(usual, SHORT_S):
            raise Overloaded(
                f"{size.width}×{size.height} pixels would keep other viewers waiting; ask for a profile, for a smaller "
                "viewport or overscan, or again when they have left.",
                retry_after_s=ACTIVE_S,
            )

    def _others(self, client: Client, now: float) -> bool:
        self._forget(now)
        return len(self._active) > (client in self._active)

    def _forget(self, now: float) -> None:
        while self._active and next(iter(self._active.values())) + ACTIVE_S < now:
            self._active.popitem(last=False)
