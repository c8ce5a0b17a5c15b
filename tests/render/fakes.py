"""Stand-ins for the rasteriser and the scenes, under the test's control."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import threading
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tigas_common.errors import UnknownScene
from tigas_common.wire.render import FrameFormat, RenderRequest, Rung
from tigas_render.encode.depth_segment import encode_depth
from tigas_render.gaussians import Batches
from tigas_render.raster.base import Camera, Image, Pause, PreparedScene, Rasterizer
from tigas_render.raster.calls import Call, CallError, FrameCalls
from tigas_render.raster.lanes import FetchedImage, Job, LaneRasterizer


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
    """Encodes as text, or as grey planes."""

    width: int
    height: int
    text: str
    closed: bool = False
    encoded: int = 0

    def encode(self, format: FrameFormat, quality: int) -> bytes:
        self.encoded += 1
        if format == "yuv420p":
            return bytes((128,)) * (self.width * self.height * 3 // 2)
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
        """The image of a frame."""
        return FakeImage(width, height, text=f"{width}x{height}")

    def before_image(self, camera: Camera, pause: Pause | None) -> None:
        """A step between the gate and the image, for subclasses."""

    def pack(self, scene: Batches) -> PreparedScene:
        if self.error is not None:
            raise self.error
        scene.read_all()
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
        self.before_image(camera, pause)
        size = (camera.intrinsics.width, camera.intrinsics.height)
        self.images.append(self.image(*size))
        if depth:
            self.images[-1].depth = np.full((9, 16), 0.5, np.float32)
        return self.images[-1]


@dataclass
class FakeLaneRasterizer(LaneRasterizer, FakeRasterizer):
    """The same with a single lane, so that each frame ends before the next begins."""

    frames_in_flight: int = 1

    def job(self, scene: PreparedScene, camera: Camera, format: FrameFormat, quality: int, *, depth: bool) -> Job:
        return FakeJob(self, scene, camera, format, quality, depth)


STATUS = ctypes.CFUNCTYPE(ctypes.c_int)


@dataclass
class FakeJob(Job):
    """Renders and encodes with its rasteriser, on the native thread."""

    rasterizer: FakeRasterizer
    scene: PreparedScene
    camera: Camera
    format: FrameFormat
    quality: int
    depth: bool
    image: FetchedImage | None = None

    def calls(self) -> FrameCalls:
        function: Any = STATUS(self._make)
        function.__name__ = "make"
        return FrameCalls((Call(function, ()),), ())

    def _make(self) -> int:
        try:
            with FakeRasterizer.render(
                self.rasterizer, self.scene, self.camera, self.format, depth=self.depth
            ) as image:
                is_png = self.format == "png"
                content = image.to_host().tobytes() if is_png else image.encode(self.format, self.quality)
                depth = None if image.depth is None else encode_depth(image.depth)
                self.image = FetchedImage(image.width, image.height, self.format, self.quality, content, depth)
        except Exception:
            return 1
        return 0

    def fetched(self) -> FetchedImage | None:
        return self.image

    @contextlib.contextmanager
    def explained(self) -> Iterator[None]:
        try:
            yield
        except CallError as error:
            raise self.rasterizer.error or error from None


@dataclass(frozen=True)
class FakeLoaded:
    """A loaded scene."""

    prepared: PreparedScene = field(default_factory=FakeScene)
    background: tuple[float, float, float] = (0.0, 0.5, 1.0)
    ladder: tuple[Rung, ...] | None = None
    is_coarse: bool = False


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

    def use(self, scene_id: str, *, coarse: bool = False) -> FakeUse:
        return FakeUse(self, scene_id, coarse)

    def evict(self) -> bool:
        self.evicted += 1
        return self.evictable >= self.evicted


@dataclass
class FakeUse:
    """A context manager with the one scene."""

    scenes: FakeScenes
    scene_id: str
    coarse: bool = False

    def enter_if_loaded(self) -> FakeLoaded | None:
        if self.scene_id != "scene":
            raise UnknownScene(f"There is no scene {self.scene_id!r}.")
        is_loading = self.scenes.loading is not None
        return None if is_loading and not self.coarse else self._enter(is_coarse=is_loading)

    async def enter(self) -> FakeLoaded:
        assert self.scenes.loading is not None
        await asyncio.shield(self.scenes.loading)
        return self._enter()

    def leave(self) -> None:
        self.scenes.users -= 1

    def _enter(self, *, is_coarse: bool = False) -> FakeLoaded:
        self.scenes.users += 1
        loaded = FakeLoaded(ladder=self.scenes.ladder, is_coarse=is_coarse)
        self.scenes.last = weakref.ref(loaded)
        return loaded
