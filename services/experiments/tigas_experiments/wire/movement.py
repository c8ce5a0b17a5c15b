"""The format of movement traces, read by the lab and the page (docs/experiments.md)."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field
from typing_extensions import TypedDict

Anchor = Literal["start", "scene"]
"""`start`: relative to the scene's start camera, from the origin and looking along z. `scene`: in the scene's levelled
frame."""
ANCHORS: tuple[Anchor, ...] = get_args(Anchor)
Unit = Literal["m", "scene"]
"""Unit of positions: metres, or the scene's own."""
UNITS: tuple[Unit, ...] = get_args(Unit)
COLUMNS = ("t_ms", "x", "y", "z", "qx", "qy", "qz", "qw")
MAX_DURATION_MS = 86_400_000.0
MAX_COORDINATE = 1e6
QUATERNION_LENGTHS = (0.1, 10.0)
"""Accepted lengths of a quaternion, as rotations may be rounded or scaled."""
VIEW_M = 4.0
"""Assumed distance in metres from the scene's start camera to its subject, as a scene does not define its unit."""


class TimedPose(TypedDict):
    """A pose at a time, in the scene's own frame."""

    t_ms: float
    position: Annotated[list[float], Field(fail_fast=True)]
    quaternion: Annotated[list[float], Field(fail_fast=True)]
