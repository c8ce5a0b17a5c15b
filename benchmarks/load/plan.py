"""The requests of a measurement's viewers, passed to their processes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import TypeAdapter

from tigas_common.sample_cameras import intrinsics
from tigas_common.wire.render import RenderRequest, SceneInfo
from tigas_experiments.movement.trace import MovementTrace, place_in_scene

Transport = Literal["webtransport", "post", "mixed"]

ARRIVALS_PER_S = 40.0
"""New viewers per second, in all processes together."""
PATIENCE_S = 1.0
"""How long after the end of a measurement the last frames are waited for."""
WIDTH, HEIGHT = 1280, 720
"""Of every viewer's display, in pixels."""


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

    @classmethod
    def of(
        cls,
        address: tuple[str, int],
        scene: SceneInfo,
        movements: Sequence[Path],
        *,
        transport: Transport,
        frames_per_s: float,
        profile: int,
        depth: bool = False,
    ) -> Self:
        """Viewers that walk along movements in a scene of a service. Raises MovementError."""
        view = {"scene": scene.id, **asdict(intrinsics(WIDTH, HEIGHT)), "profile": profile, "depth": depth}
        routes = tuple(_route(MovementTrace.read(path), scene, frames_per_s) for path in movements)
        plan = cls(*address, transport, frames_per_s, _fields(view), routes)
        RenderRequest.model_validate_json(plan.request(0, 0, 0))
        return plan

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
        return TypeAdapter(cls).validate_json(text)


def _route(movement: MovementTrace, scene: SceneInfo, frames_per_s: float) -> tuple[str, ...]:
    times = np.arange(0, max(movement.duration_ms, 1), 1000 / frames_per_s)
    positions, quaternions = movement.poses_at(times)
    points = place_in_scene(replace(movement, times_ms=times, positions=positions, quaternions=quaternions), scene)
    return tuple(
        _fields({name: [round(value, 6) for value in point[name]] for name in ("position", "quaternion")})
        for point in points
    )


def _fields(fields: dict[str, Any]) -> str:
    return json.dumps(fields)[1:-1]
