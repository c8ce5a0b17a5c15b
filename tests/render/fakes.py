"""Stand-ins for the rasteriser and the scenes, under the test's control."""

from __future__ import annotations

import asyncio
import threading
import weakref
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tigas_common.errors import UnknownScene
from tigas_common.wire.render import FrameFormat, RenderRequest, Rung
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera, Image, Pause, PreparedScene, Rasterizer


def render_request(**changes: Any) -> RenderRequest:
    """A valid request, with changes."""
    fields: dict[str, Any] = {
        "scene": "scene",
        "azimuth": 0.0,
        "elevation": 0.0,
        "translation": (0.0, 0.0, 0.0),
        "fx": 300.0,
        "fy": 300.0,
        "cx": 160.0,
        "cy": 90.0,
        "width": 320,
        "height": 180,
        "profile": 3,
    }
    return RenderRequest(**(fields | changes))


class FakeScene(PreparedScene):
    """A scene that takes 100 bytes."""

    @property
    def nbytes(self) -> int:
        return 100


@dataclass
class FakeImage(Image):
    """Encodes as the text of what was asked for."""

    width: int
    height: int
    text: str
    closed: bool = False
    encoded: int = 0

    def encode(self, format: FrameFormat, quality: int) -> bytes:
        self.encoded += 1
        return f"{self.text} {format} {quality}".encode()

    def to_host(self) -> NDArray[np.uint8]:
        return np.zeros((self.height, self.width, 3), np.uint8)

    def close(self) -> None:
        self.closed = True


@dataclass
class FakeRasterizer(Rasterizer):
    """Renders when the test lets it: `gate` holds every render up while it is not set."""

    device: str = "fake"
    gate: threading.Event = field(default_factory=threading.Event)
    started: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(0))
    cameras: list[Camera] = field(default_factory=list)
    images: list[FakeImage] = field(default_factory=list)
    error: Exception | None = None
    frames_in_flight: int = 2
    formats: list[FrameFormat] = field(default_factory=list)

    def image(self, width: int, height: int) -> FakeImage:
        """What is rendered."""
        return FakeImage(width, height, text=f"{width}x{height}")

    def prepare(self, gaussians: Gaussians) -> PreparedScene:
        if self.error is not None:
            raise self.error
        return FakeScene()

    def render(
        self,
        scene: PreparedScene,
        camera: Camera,
        format: FrameFormat = "jpeg",
        pause: Pause | None = None,
        *,
        depth: bool = False,
    ) -> Image:
        self.cameras.append(camera)
        self.formats.append(format)
        self.started.release()
        assert self.gate.wait(10)
        if self.error is not None:
            raise self.error
        size = (camera.intrinsics.width, camera.intrinsics.height)
        self.images.append(self.image(*size))
        if depth:
            self.images[-1].depth = np.full((9, 16), 0.5, np.float32)
        return self.images[-1]


@dataclass(frozen=True)
class FakeLoaded:
    """A loaded scene."""

    prepared: PreparedScene = field(default_factory=FakeScene)
    background: tuple[float, float, float] = (0.0, 0.5, 1.0)
    ladder: tuple[Rung, ...] | None = None


@dataclass
class FakeScenes:
    """Knows one scene, `scene`, and counts its users."""

    users: int = 0
    evictable: int = 0
    evicted: int = 0
    ladder: tuple[Rung, ...] | None = None
    """The scene's own."""
    last: weakref.ref[FakeLoaded] | None = None
    """The scene that was given out last."""
    loading: asyncio.Future[None] | None = None
    """Set: the scene has to be loaded, which takes until this is done."""

    def use(self, scene_id: str) -> FakeUse:
        return FakeUse(self, scene_id)

    def evict(self) -> bool:
        self.evicted += 1
        return self.evictable >= self.evicted


@dataclass
class FakeUse:
    """What holds the one scene."""

    scenes: FakeScenes
    scene_id: str

    def enter_if_loaded(self) -> FakeLoaded | None:
        if self.scene_id != "scene":
            raise UnknownScene(f"There is no scene {self.scene_id!r}.")
        return None if self.scenes.loading is not None else self._enter()

    async def enter(self) -> FakeLoaded:
        assert self.scenes.loading is not None
        await asyncio.shield(self.scenes.loading)
        return self._enter()

    def leave(self) -> None:
        self.scenes.users -= 1

    def _enter(self) -> FakeLoaded:
        self.scenes.users += 1
        loaded = FakeLoaded(ladder=self.scenes.ladder)
        self.scenes.last = weakref.ref(loaded)
        return loaded
