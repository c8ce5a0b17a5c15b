"""Start views: from scene.json, or derived from the Gaussians once and cached."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from tigas_common.errors import InvalidRequest
from tigas_common.files import read_regular
from tigas_common.parsing import parse
from tigas_common.wire.model import Point, WireModel
from tigas_common.wire.render import StartCamera
from tigas_render.gaussians import Gaussians
from tigas_render.local_files import write_to_cache
from tigas_render.scenes.source import DEFAULT_UP, SceneMetadata, SceneSource
from tigas_render.scenes.start_view.grid import Grid
from tigas_render.scenes.start_view.inside import best_view
from tigas_render.scenes.start_view.outside import view_from_outside
from tigas_render.scenes.start_view.places import find_places
from tigas_render.scenes.start_view.surfels import Doubles, Surfels, surfels
from tigas_render.scenes.start_view.up_axis import likely_axes, object_axis

VERSION = 1
"""Version of the derivation; increment it when start views change, so that old cached ones are not used."""
MAX_BYTES = 10_000
"""Maximum size of a cached view's file."""


class StartView(WireModel):
    """A start camera and its up axis."""

    up: Point
    camera: StartCamera


class StartViewCache:
    """A cache of start views in `directory`, which is created when needed. Scenes' folders are never written to."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def read(self, source: SceneSource) -> StartView | None:
        """A scene's cached view, if any."""
        try:
            return parse(StartView, read_regular(self._path(source), MAX_BYTES))
        except (OSError, InvalidRequest):
            return None

    def write(self, source: SceneSource, view: StartView) -> None:
        """Cache a scene's view, if possible."""
        write_to_cache(self._path(source), view.model_dump_json().encode())

    def _path(self, source: SceneSource) -> Path:
        """The cache file, whose name depends on everything that the view depends on."""
        key = f"{VERSION}|{source.version}|{source.metadata.up}"
        return self._directory / f"start-view-{hashlib.sha256(key.encode()).hexdigest()[:32]}.json"


def view_from_metadata(metadata: SceneMetadata) -> StartView | None:
    """The start view in a scene.json; None without a camera. A camera without an up axis has y down."""
    if metadata.camera is None:
        return None
    return StartView(up=metadata.up or DEFAULT_UP, camera=metadata.camera)


def resolve_view(metadata: SceneMetadata, sample: Gaussians, share: float) -> StartView:
    """The start view in a scene.json, or one derived from a sample with this share of the Gaussians."""
    return view_from_metadata(metadata) or derive_view(sample, metadata.up, share)


def derive_view(sample: Gaussians, up: Point | None = None, share: float = 1.0) -> StartView:
    """Derive the start view from a sample with this share of a scene's Gaussians. The result is deterministic.

    up: the up axis, of any length, if it is known; otherwise derived as well. Captures that surround the viewer are
    seen from inside at eye height, others from outside.
    """
    found = surfels(sample)
    likely = [] if up is not None else likely_axes(found)
    axis = likely[0].up if up is None else np.array(up, np.float64)
    inside = _view_from_inside(found, axis, share)
    if inside is None:
        axis = object_axis(likely) if up is None else axis
    frame = level_frame(axis)
    position, focus = inside or _outside(found, frame)
    return StartView(
        up=up or _point(axis), camera=StartCamera(position=_point(position @ frame), look_at=_point(focus @ frame))
    )


def _view_from_inside(found: Surfels, up: Doubles, share: float) -> tuple[Doubles, Doubles] | None:
    level = found.rotated(level_frame(up))
    grid = Grid(level, share)
    places = find_places(grid, Grid(level, share, whole=True))
    return None if places is None else best_view(grid, places, np.median(level.centres, axis=0))


def _outside(found: Surfels, frame: Doubles) -> tuple[Doubles, Doubles]:
    return view_from_outside(found.centres @ frame.T, float(np.median(found.extents[:, 2])))


def level_frame(up: Doubles) -> Doubles:
    """[3, 3] rows right, down and forward, where forward is the horizontal direction closest to +z."""
    down = -up / np.linalg.norm(up)
    ahead = np.array([0.0, 0.0, 1.0] if abs(down[2]) < 0.9 else [0.0, 1.0, 0.0])
    forward = ahead - down * (ahead @ down)
    forward /= np.linalg.norm(forward)
    return np.stack((np.cross(down, forward), down, forward))


def _point(vector: Doubles) -> Point:
    x, y, z = (float(value) + 0.0 for value in vector)  # no -0
    return (x, y, z)
