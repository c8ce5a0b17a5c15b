"""Thumbnails of scenes: the scene's own image, or a rendered one from the cache."""

from __future__ import annotations

import asyncio
import hashlib
import io
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from tigas_common.files import read_regular
from tigas_common.pose import Pose
from tigas_common.sample_cameras import intrinsics
from tigas_common.wire.model import Point
from tigas_common.wire.render import StartCamera
from tigas_render.local_files import write_to_cache
from tigas_render.raster.base import Camera
from tigas_render.scenes.source import SceneSource
from tigas_render.scenes.start_view.view import VERSION
from tigas_render.single_flight import SingleFlight

WIDTH, HEIGHT = 640, 360
MAX_BYTES = 8_000_000
"""Maximum size of the image that a scene may include."""
MAX_PIXELS = 33_000_000

_MEDIA_TYPES = {"JPEG": "image/jpeg", "PNG": "image/png"}

_log = logging.getLogger(__name__)

RenderPreview = Callable[[str], Awaitable[bytes]]
"""Renders a scene (by id) from its start camera as a JPEG of WIDTH × HEIGHT pixels."""


@dataclass(frozen=True, slots=True)
class Preview:
    """The content of an image file."""

    body: bytes
    media_type: str


class PreviewCache:
    """Previews of scenes. Rendered ones are cached in `directory`, which is created when needed."""

    def __init__(self, directory: Path, render: RenderPreview) -> None:
        self._directory = directory
        self._render = render
        self._rendering = SingleFlight[Path, Preview]()

    async def get(self, source: SceneSource) -> Preview:
        """The scene's preview, rendered once for concurrent requests. Raises the errors of rendering."""
        if source.preview is not None:
            own = await asyncio.to_thread(read_preview, source.preview)
            if own is not None:
                return own
            _log.warning(
                "%s is not a JPEG or PNG of at most %d MB; a preview is rendered", source.preview, MAX_BYTES // 10**6
            )
        path = self._path(source)
        return await self._rendering.get(path, lambda: self._cached_or_rendered(source.id, path))

    def _path(self, source: SceneSource) -> Path:
        """The cache file, whose name depends on everything that the image depends on."""
        key = f"{VERSION}|{source.id}|{source.version}|{source.metadata.appearance_key}|{WIDTH}x{HEIGHT}"
        return self._directory / f"preview-{hashlib.sha256(key.encode()).hexdigest()[:32]}.jpg"

    async def _cached_or_rendered(self, scene_id: str, path: Path) -> Preview:
        cached = await asyncio.to_thread(read_preview, path)
        if cached is not None:
            return cached
        body = await self._render(scene_id)
        await asyncio.to_thread(write_to_cache, path, body)
        return Preview(body, "image/jpeg")


def read_preview(path: Path) -> Preview | None:
    """Read an image file: None if it is missing, too large, or not a valid JPEG or PNG by its content."""
    try:
        body = read_regular(path, MAX_BYTES)
        with Image.open(io.BytesIO(body), formats=tuple(_MEDIA_TYPES)) as image:
            if image.width * image.height > MAX_PIXELS or image.format is None:
                return None
            media_type = _MEDIA_TYPES[image.format]
            image.load()
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return None
    return Preview(body, media_type)


def preview_camera(start: StartCamera, up: Point, width: int, height: int) -> Camera:
    return Camera(Pose.look_at(start.position, start.look_at, up), intrinsics(width, height))
