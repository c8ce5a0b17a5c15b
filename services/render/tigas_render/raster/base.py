"""The interface of every rasteriser, independent of requests, queues and sockets."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import FrameFormat
from tigas_render.encode.depth_segment import CodedDepth
from tigas_render.gaussians import Batches, Gaussians

NEAR_PLANE = 0.01
"""Minimum depth of a Gaussian's centre, in scene units; nearer ones are not drawn."""
DILATION = 0.3
"""Added to the diagonal of each projected covariance during training, in pixels² (3DGS)."""
ALPHA_MIN = 1 / 255
"""Minimum alpha with which a Gaussian contributes to a pixel."""
ALPHA_MAX = 0.999
"""Maximum alpha of a single Gaussian, to which it is clamped."""
TRANSMITTANCE_MIN = 1e-4
"""Transmittance below which a pixel is finished."""
CLAMP_MARGIN = 0.3
"""Distance outside the viewport at which the projection's derivative is clamped, in half-widths (gsplat 1.5.3)."""
DEPTH_PIXELS = 184 * 104
"""Maximum number of pixels of a depth map, in any shape. A finer map did not improve warped frames."""
DEPTH_FINEST = 0.5
"""Maximum resolution of a depth map relative to the image, on each side."""
OPACITY_MIN = 0.1
"""Minimum opacity of a pixel for it to have a depth."""
BASIS_CONSTANTS = (
    0.28209479177387814,
    *(-0.4886025119029199, 0.4886025119029199, -0.4886025119029199),
    *(1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396),
    *(-0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154),
    *(-0.4570457994644658, 1.445305721320277, -0.5900435899266435),
)
"""The constant factors of the spherical harmonics, including signs (Kerbl et al., 3DGS, 2023). Packed coefficients are
already multiplied by them."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A view: camera pose, lens and background."""

    pose: Pose
    intrinsics: Intrinsics
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """RGB, 0 to 1."""
    display_scale: float = 1.0
    """Linear scale at which the image is displayed, at least 1. See `footprint`."""
    margins: tuple[int, int] = (0, 0)
    """Columns on each side, and rows above and below, beyond the viewport. They are included in `intrinsics`, and do
    not change the rest of the image."""
    full_detail: bool = False
    """Whether to draw a large scene in full, instead of at the level of detail that the pixels can show."""

    @property
    def viewport(self) -> Intrinsics:
        """The intrinsics without the margins."""
        return self.intrinsics.with_margins(-self.margins[0], -self.margins[1])


Pause = Callable[[], None]
Depth = NDArray[np.float32]
"""Inverse depth of the whole image, [h, w] in 1/scene units, at the resolution of `depth_size`; 0 is infinitely far.
Depth is measured along z, not along the ray.
"""


class PreparedScene(ABC):
    """A scene packed by one rasteriser for its own device."""

    @property
    @abstractmethod
    def nbytes(self) -> int:
        """Memory of the scene on its device, in bytes."""


class Image(ABC):
    """A rendered image in the host's memory; a context manager that releases it."""

    width: int
    height: int
    depth: Depth | None = None
    """The view's depth, if it was requested and not encoded by the device."""
    coded_depth: CodedDepth | None = None
    """The view's depth, if it was requested and encoded by the device."""
    rendering: float = 0.0
    """Seconds spent on rendering."""
    encoding: float = 0.0
    """Seconds spent on encoding before `encode` is called."""

    @abstractmethod
    def encode(self, format: FrameFormat, quality: int) -> bytes:
        """Encode the image as `jpeg` (at `quality` 1 to 100), `png`, or planar `yuv420p`."""

    @abstractmethod
    def to_host(self) -> NDArray[np.uint8]:
        """The pixels, RGB [H, W, 3]; the caller may modify them until the image is closed."""

    def close(self) -> None:  # noqa: B027 - not every image holds any
        """Return the image's memory to its rasteriser. Closing again does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Rasterizer(ABC):
    """Renders prepared scenes. Call it from one thread at a time unless an implementation documents otherwise."""

    device: str
    """The device's name, such as `cpu` or `cuda:0`."""
    frames_in_flight: int = 2
    """Number of concurrent frames that keeps the device busy, either because encoding overlaps rendering or because
    streams overlap one another."""

    makes_webp: bool = False
    """Whether to offer frames as WebP, which is always encoded on the host."""

    @property
    def hardware(self) -> str:
        """The processor's name: `cpu`, or the model of the GPU."""
        return self.device

    @abstractmethod
    def pack(self, scene: Batches) -> PreparedScene:
        """Pack a scene for rendering while it is read. Safe to call from any thread, and does not block frames.

        Raises the errors of reading.
        """

    def prepare(self, gaussians: Gaussians) -> PreparedScene:
        """Pack a scene that is already in memory. The arrays are not needed afterwards."""
        return self.pack(gaussians.batches())

    @abstractmethod
    def render(
        self,
        scene: PreparedScene,
        camera: Camera,
        format: FrameFormat = "jpeg",
        pause: Pause | None = None,
        *,
        depth: bool = False,
    ) -> Image:
        """Render one view at the resolution of the intrinsics.

        format: the format in which the image will be encoded; a device may encode it immediately.
        pause: may be called every few milliseconds while rendering; it may itself call `render`, without a pause.
        depth: whether to add the view's depth, which does not change the pixels.
        """

    def warm_up(self) -> None:  # noqa: B027 - a rasteriser without a compiler has nothing to do
        """Do everything in advance that would delay the first frame, such as compiling."""


def footprint(display_scale: float, antialiased: bool = False) -> tuple[float, float]:
    """Growth of a Gaussian on screen: dilation, and variance of the low-pass filter, both in the image's pixels².

    The projected covariance Σ becomes Σ' = Σ + dilation · I, as large on the display as in training, and then
    Σ" = Σ' + low_pass · I, with the opacity times √(det Σ' / det Σ"), which preserves its coverage: the 2D filter of
    Mip-Splatting (Yu et al., CVPR 2024). A box one pixel wide has a variance of 1/12. With s = display_scale, the
    variance of a pixel of the image exceeds that of a display pixel, as used in training, by 1/12 - 1/(12 s²); half of
    it is left to the upscaling (docs/architecture.md). At s = 1 there is no filter, and the image is 3DGS's.

    In a scene trained with that filter (`antialiased`), the dilation is part of the filter, and reduces opacity too.
    """
    shrunk = 1 / display_scale**2
    if antialiased:
        return 0.0, DILATION * shrunk + (1 - shrunk) / 24
    return DILATION * shrunk, (1 - shrunk) / 24


def derivative_limits(k: Intrinsics) -> tuple[float, float, float, float]:
    """Limits of x/z and y/z at which the projection's derivative is taken: left, right, top, bottom.

    k: the viewport's intrinsics. Margins do not widen the limits, because that would change the shapes of Gaussians
    that reach into the viewport.
    """
    margin_x, margin_y = CLAMP_MARGIN * 0.5 * k.width / k.fx, CLAMP_MARGIN * 0.5 * k.height / k.fy
    return (
        -k.cx / k.fx - margin_x,
        (k.width - k.cx) / k.fx + margin_x,
        -k.cy / k.fy - margin_y,
        (k.height - k.cy) / k.fy + margin_y,
    )


def depth_size(width: int, height: int) -> tuple[int, int]:
    """Columns and rows of the depth map for an image of this size in pixels."""
    scale = min(DEPTH_FINEST, math.sqrt(DEPTH_PIXELS / (width * height)))
    return max(1, round(width * scale)), max(1, round(height * scale))


def coarse(camera: Camera) -> Camera:
    """The same view at the resolution of its depth map, to be displayed at the same size on screen."""
    intrinsics, scale, margins = _coarse(camera.intrinsics, camera.margins)
    return Camera(camera.pose, intrinsics, (0.0, 0.0, 0.0), camera.display_scale * scale, margins, camera.full_detail)


@lru_cache(maxsize=1024)  # a viewer uses the same lens, or a few, for thousands of frames
def _coarse(k: Intrinsics, margins: tuple[int, int]) -> tuple[Intrinsics, float, tuple[int, int]]:
    columns, rows = depth_size(k.width, k.height)
    scale = math.sqrt(k.width * k.height / (columns * rows))
    return k.resized(columns, rows), scale, (round(margins[0] / scale), round(margins[1] / scale))


def inverse_depth(means: NDArray[np.float32]) -> Depth:
    """Expected inverse depth, float32 [h, w] in 1/scene units; 0, infinitely far, for empty pixels.

    means [h, w, 2]: of weight / z and of weight, the share of light that a Gaussian contributes to the image (its alpha
    times the transmittance before it). Inverse depth, unlike depth, may be averaged, because it is linear in the image.
    The median is no better than the expectation: views of the courtyard warped by 5 and 20 cm had 37.2 and 26.2 dB with
    the expectation, 35.9 and 25.3 dB with the median.
    """
    inverse, opacity = means[..., 0], means[..., 1]
    return np.divide(inverse, opacity, out=np.zeros_like(inverse), where=opacity >= OPACITY_MIN)


def one_gaussian() -> Gaussians:
    """A scene of one Gaussian, for warming up."""
    return Gaussians(
        means=np.array([[0, 0, 1]], np.float32),
        scales=np.full((1, 3), 0.1, np.float32),
        quaternions=np.array([[1, 0, 0, 0]], np.float32),
        opacities=np.full(1, 0.5, np.float32),
        sh=np.zeros((1, 1, 3), np.float32),
    )
