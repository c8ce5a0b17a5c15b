"""Cameras, NumPy's pictures of their views, and the page's canvas with a warp."""

from __future__ import annotations

import base64
import io
import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page

Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class View:
    """As `View` in web/packages/viewer/reproject/view.ts; turns are in degrees: to the right, up, and clockwise."""

    position: tuple[float, float, float] = (0, 0, 0)
    turn: tuple[float, float, float] = (0, 0, 0)
    fx: float = 80
    fy: float = 80
    cx: float = 48
    cy: float = 27
    width: int = 96
    height: int = 54

    @property
    def quaternion(self) -> list[float]:
        """[x, y, z, w], camera to world."""
        (sa, sb, sc), (ca, cb, cc) = (f(np.radians(self.turn) / 2) for f in (np.sin, np.cos))
        about_y_x = np.array([ca * sb, sa * cb, -sa * sb, ca * cb])
        x, y, z, w = about_y_x
        return [x * cc + y * sc, y * cc - x * sc, z * cc + w * sc, w * cc - z * sc]

    @property
    def rotation(self) -> Floats:
        """[3, 3], camera to world."""
        a, b, c = np.radians(self.turn)
        yaw = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
        pitch = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
        roll = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
        rotation: Floats = yaw @ pitch @ roll
        return rotation

    @property
    def directions(self) -> Floats:
        """[height, width, 3] in the world, through the middle of each pixel, 1 long along the camera's axis."""
        y, x = np.mgrid[: self.height, : self.width] + 0.5
        rays = np.stack([(x - self.cx) / self.fx, (y - self.cy) / self.fy, np.ones_like(x)], axis=2)
        directions: Floats = rays @ self.rotation.T
        return directions

    def pixels_of(self, points: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Where points [..., 3] of the world are seen, in pixels [..., 2], and whether they are in the picture."""
        x, y, z = np.moveaxis((points - np.array(self.position)) @ self.rotation, -1, 0)
        ahead = np.where(z > 0, z, np.nan)
        u, v = x / ahead * self.fx + self.cx, y / ahead * self.fy + self.cy
        return np.stack([u, v], axis=-1), (u > 0) & (v > 0) & (u < self.width) & (v < self.height)

    def with_margins(self, x: int, y: int) -> View:
        return replace(self, cx=self.cx + x, cy=self.cy + y, width=self.width + 2 * x, height=self.height + 2 * y)

    def scaled(self, by: int) -> View:
        lens = {name: getattr(self, name) * by for name in ("fx", "fy", "cx", "cy", "width", "height")}
        return replace(self, **lens)

    @property
    def message(self) -> dict[str, Any]:
        """For the page."""
        lens = {name: value for name, value in asdict(self).items() if name != "turn"}
        return lens | {"quaternion": self.quaternion}


HOME = View()
WIDE = HOME.with_margins(24, 14)


def colours(points: Floats) -> Pixels:
    """A smooth texture of space: colours at these points, [..., 3] to [..., 3]."""
    x, y, z = np.moveaxis(points, -1, 0)
    waves = [np.sin(7 * x + 2 * y) * np.cos(5 * z), np.sin(6 * y + 3 * z), np.cos(6 * x - 5 * y + 2 * z)]
    return np.round(127.5 + 110 * np.stack(waves, axis=-1)).astype(np.uint8)


def far_away(view: View) -> Pixels:
    """A panorama that is infinitely far."""
    directions = view.directions
    return colours(directions / np.linalg.norm(directions, axis=2, keepdims=True))


def on_a_wall(view: View, at: float) -> Pixels:
    """A wall across the world's z axis."""
    directions, position = view.directions, np.array(view.position)
    reach = (at - position[2]) / directions[..., 2:]
    return colours((position + reach * directions) / at)


def on_a_sphere(view: View, radius: float) -> Pixels:
    """Seen from within one around the origin."""
    directions = view.directions / np.linalg.norm(view.directions, axis=2, keepdims=True)
    position = np.array(view.position)
    along = directions @ position
    reach = -along + np.sqrt(along**2 + radius**2 - position @ position)
    return colours((position + reach[..., None] * directions) / radius)


def noise(width: int, height: int) -> Pixels:
    return np.random.default_rng(width).integers(0, 256, (height, width, 3), dtype=np.uint8)


def flat_depth(inverse_depth: float, width: int = 23, height: int = 13) -> dict[str, Any]:
    return depth_of(np.full((height, width), inverse_depth), inverse_depth)


def depth_of(inverse_depths: Floats, nearest: float) -> dict[str, Any]:
    """[height, width], as the page has it."""
    height, width = inverse_depths.shape
    codes = np.round(255 * inverse_depths / nearest).astype(np.uint8)
    return {"width": width, "height": height, "nearest": nearest, "codes": base64.b64encode(codes.tobytes()).decode()}


def psnr(shown: NDArray[Any], expected: NDArray[Any], where: NDArray[np.bool_] | None = None) -> float:
    """In dB, over the pixels [height, width] that are asked about."""
    difference = shown[..., :3].astype(np.float64) - expected
    error = float(np.mean((difference if where is None else difference[where]) ** 2))
    return math.inf if error == 0 else 10 * math.log10(255**2 / error)


def encoded(picture: NDArray[np.uint8], kind: str, **options: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, kind, **options)
    return file.getvalue()


class Stage:
    """The page's canvas, with a separate warp."""

    def __init__(self, page: Page, distance: float | None) -> None:
        self.page = page
        assert page.evaluate("(distance) => begin(distance)", distance)

    def take(self, picture: Pixels, view: View, depth: dict[str, Any] | None = None) -> None:
        png = base64.b64encode(encoded(picture, "png")).decode()
        self.page.evaluate("([png, view, depth]) => take(png, view, depth)", [png, view.message, depth])

    def surround(self, picture: Pixels, view: View) -> None:
        """A side of the surround."""
        png = base64.b64encode(encoded(picture, "png")).decode()
        self.page.evaluate("([png, view]) => surround(png, view)", [png, view.message])

    def draw(self, view: View, *, enlarged: int = 1) -> Pixels:
        """[height, width, 4]."""
        width, height = view.width * enlarged, view.height * enlarged
        content = self.page.evaluate("(asked) => draw(...asked)", [view.message, width, height])
        return np.frombuffer(base64.b64decode(content), np.uint8).reshape(height, width, 4)
