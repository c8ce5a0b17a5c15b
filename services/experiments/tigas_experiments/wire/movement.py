"""The format of movement traces, read by the lab and the page (docs/experiments.md)."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field
from typing_extensions import TypedDict

Anchor = Literal["start", "scene"]
"""`start`: the movement begins at the origin and looks along z, which is the scene's start camera.
`scene`: it is in the scene's levelled frame."""
ANCHORS: tuple[Anchor, ...] = get_args(Anchor)
Unit = Literal["m", "scene"]
"""The unit of positions: metres, or the scene's own."""
UNITS: tuple[Unit, ...] = get_args(Unit)
COLUMNS = ("t_ms", "x", "y", "z", "qx", "qy", "qz", "qw")
MAX_DURATION_MS = 86_400_000.0
MAX_COORDINATE = 1e6
QUATERNION_LENGTHS = (0.1, 10.0)
"""Accepted lengths of a quaternion: a rounded or scaled rotation."""
VIEW_M = 4.0
"""The assumed distance from the scene's start camera to the point that it looks at, in metres, as a scene does not say
how long its unit is."""


class TimedPose(TypedDict):
    """A pose at a time, in the scene's own frame."""

    t_ms: float
    position: Annotated[list[float], Field(fail_fast=True)]
    quaternion: Annotated[list[float], Field(fail_fast=True)]
