"""Movements of the viewers in a scene, as poses of frames at their own rate."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.load.plan import Plan, Transport
from tigas_common.sample_cameras import intrinsics
from tigas_common.wire.render import RenderRequest, SceneInfo
from tigas_experiments.movement.trace import MovementTrace, placed

WIDTH, HEIGHT = 1280, 720
"""Of every viewer's display, in pixels."""


def make_plan(
    address: tuple[str, int],
    scene: SceneInfo,
    movements: Sequence[Path],
    *,
    transport: Transport,
    frames_per_s: float,
    profile: int,
    depth: bool = False,
    deadline_ms: float | None = None,
) -> Plan:
    """The viewers' requests for a scene of a service. Raises MovementError."""
    view: dict[str, Any] = {"scene": scene.id, **asdict(intrinsics(WIDTH, HEIGHT)), "profile": profile}
    if depth:
        view["depth"] = True
    if deadline_ms is not None:
        view["deadline_ms"] = deadline_ms
    routes = tuple(_route(MovementTrace.read(path), scene, frames_per_s) for path in movements)
    plan = Plan(*address, transport, frames_per_s, _fields(view), routes)
    RenderRequest.model_validate_json(plan.request(0, 0, 0))
    return plan


def _route(movement: MovementTrace, scene: SceneInfo, frames_per_s: float) -> tuple[str, ...]:
    times = np.arange(0, max(movement.duration_ms, 1), 1000 / frames_per_s)
    positions, quaternions = movement.poses_at(times)
    points = placed(replace(movement, times_ms=times, positions=positions, quaternions=quaternions), scene)
    return tuple(
        _fields({name: [round(value, 6) for value in point[name]] for name in ("position", "quaternion")})
        for point in points
    )


def _fields(fields: dict[str, Any]) -> str:
    return json.dumps(fields)[1:-1]
