"""Parameters of the viewers of a measurement, passed to their processes."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Literal, Self

Transport = Literal["webtransport", "post", "mixed"]

ARRIVALS_PER_S = 40.0
"""New viewers per second, in all processes together."""
PATIENCE_S = 1.0
"""How long after the end of a measurement the last frames are waited for."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Viewers of one scene."""

    host: str
    port: int
    """Where HTTP/3 is served, over UDP."""
    transport: Transport
    """How viewers ask; with `mixed`, every second by POST."""
    frames_per_s: float
    """That each viewer asks for."""
    view: str
    """The fields of a RenderRequest, as JSON without braces, that all views have in common."""
    routes: tuple[tuple[str, ...], ...]
    """For each movement, the poses of its frames: fields in the same way."""

    def request(self, route: int, frame: int, seq: int) -> bytes:
        """For a frame of a route, which begins anew at its end."""
        poses = self.routes[route]
        return f'{{"seq":{seq},{poses[frame % len(poses)]},{self.view}}}'.encode()

    def to_json(self) -> str:
        """One line, for `from_json`."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Parse the output of `to_json`."""
        given = json.loads(text)
        return cls(**{**given, "routes": tuple(map(tuple, given["routes"]))})
