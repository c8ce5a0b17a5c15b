"""Predicted frame costs, and the refusal of frames that would hold up other clients."""

from __future__ import annotations

import math
from collections import OrderedDict, defaultdict

from tigas_common.errors import Overloaded
from tigas_common.wire.render import AnswerFormat, RenderRequest, Rung
from tigas_render.engine.frame_size import FrameSize
from tigas_render.frame import Client

NEWEST_WEIGHT = 0.2
"""The weight of the newest measurement in the running mean."""
ACTIVE_S = 2.0
"""Seconds for which a client counts as active after a request or a frame."""
NORMAL_OVERSCAN = 0.25
"""Overscan up to which a rung is considered normal use; the page never requests more unless the user chooses it."""
MAX_WAIT_S = 0.05
"""Seconds that a client may have to wait for another client's frame, whatever the frame's size."""


class CostModel:
    """Running means of frame costs by scene, format and size class, where each class spans a factor of two.

    Cost is not proportional to pixels, because projecting and sorting take as long for a small frame. For sizes that
    have not been measured the model therefore gives only bounds: a larger frame costs at least as much as a smaller
    one, and at most in proportion to its pixels.
    """

    def __init__(self) -> None:
        self._means: defaultdict[tuple[str, AnswerFormat], dict[int, float]] = defaultdict(dict)

    def add_measurement(self, scene: str, format: AnswerFormat, pixels: int, seconds: float) -> None:
        means, size = self._means[scene, format], pixels.bit_length()
        means[size] = (1 - NEWEST_WEIGHT) * means.get(size, seconds) + NEWEST_WEIGHT * seconds

    def lower_bound(self, scene: str, format: AnswerFormat, pixels: int) -> float:
        """A lower bound on the cost of a frame of this size, in seconds; 0 without measurements."""
        means, size = self._means.get((scene, format), {}), pixels.bit_length()
        if size in means:
            return means[size]
        return max((seconds * min(1.0, 2.0 ** (size - other)) for other, seconds in means.items()), default=0.0)

    def upper_bound(self, scene: str, format: AnswerFormat, pixels: int) -> float:
        """An upper bound on the cost of a frame of this size, in seconds; infinite without measurements."""
        means, size = self._means.get((scene, format), {}), pixels.bit_length()
        if size in means:
            return means[size]
        return min((seconds * max(1.0, 2.0 ** (size - other)) for other, seconds in means.items()), default=math.inf)

    def decay(self, scene: str, format: AnswerFormat) -> None:
        """Lower the estimates that led to a refusal; otherwise they would never be measured again."""
        means = self._means.get((scene, format), {})
        for size in means:
            means[size] *= 0.9


class LargeFrameLimit:
    """Refuses slow frames larger than the best rung while another client is active."""

    def __init__(self, ladder: tuple[Rung, ...], costs: CostModel) -> None:
        self._costs = costs
        self._best = max(rung.width * rung.height for rung in ladder)
        self._active: OrderedDict[tuple[str, str], float] = OrderedDict()
        """Last activity of each viewer, oldest first."""

    def record_activity(self, client: Client, now: float) -> None:
        """Record a client's request, or the start of its frame."""
        viewer = client.viewer
        self._active[viewer] = now
        self._active.move_to_end(viewer)
        self._expire(now)

    def check(self, client: Client, request: RenderRequest, size: FrameSize, now: float, *, others_wait: bool) -> None:
        """Raise Overloaded, with a retry time, if a request must wait until no other client is active."""
        is_usual = request.profile is not None and request.overscan <= NORMAL_OVERSCAN
        if is_usual or size.pixels <= self._best or not (others_wait or self._has_other_active(client, now)):
            return
        usual = self._costs.lower_bound(request.scene, request.format, self._best)
        if self._costs.upper_bound(request.scene, request.format, size.pixels) > max(usual, MAX_WAIT_S):
            raise Overloaded(
                f"{size.width}×{size.height} pixels would keep other viewers waiting; request a profile, a smaller "
                "viewport or less overscan, or try again later.",
                retry_after_s=ACTIVE_S,
            )

    def _has_other_active(self, client: Client, now: float) -> bool:
        self._expire(now)
        return len(self._active) > (client.viewer in self._active)

    def _expire(self, now: float) -> None:
        while self._active and next(iter(self._active.values())) + ACTIVE_S < now:
            self._active.popitem(last=False)
