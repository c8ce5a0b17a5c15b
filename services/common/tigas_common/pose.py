"""Camera pose and intrinsics, in OpenCV's axes: x right, y down, z forward."""

from __future__ import annotations

import math
from dataclasses import dataclass

Vector3 = tuple[float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]


@dataclass(frozen=True, slots=True)
class Pose:
    """A camera's position and orientation: the camera-to-world transform, in the scene's own frame and units."""

    position: Vector3
    """The camera's centre, in scene units."""
    rotation: Matrix3
    """R [3, 3], camera to world, row by row: column 2 is the viewing direction."""

    @classmethod
    def from_euler(cls, azimuth: float, elevation: float, roll: float, translation: Vector3) -> Pose:
        """R = Ry(azimuth) · Rx(elevation) · Rz(roll), all in degrees.

        Positive azimuth turns right, positive elevation looks up, positive roll turns the camera clockwise.
        """
        ca, sa = math.cos(math.radians(azimuth)), math.sin(math.radians(azimuth))
        ce, se = math.cos(math.radians(elevation)), math.sin(math.radians(elevation))
        cr, sr = math.cos(math.radians(roll)), math.sin(math.radians(roll))
        return cls(
            translation,
            (
                (ca * cr + sa * se * sr, -ca * sr + sa * se * cr, sa * ce),
                (ce * sr, ce * cr, -se),
                (-sa * cr + ca * se * sr, sa * sr + ca * se * cr, ca * ce),
            ),
        )

    @classmethod
    def from_quaternion(cls, position: Vector3, quaternion: tuple[float, float, float, float]) -> Pose:
        """Create a pose from a camera-to-world quaternion [x, y, z, w], which need not be normalised.

        Raises ValueError if the quaternion is zero.
        """
        scale = max(map(abs, quaternion))
        if scale == 0:
            raise ValueError("a quaternion of length zero is not a rotation")
        x, y, z, w = quaternion
        x, y, z, w = x / scale, y / scale, z / scale, w / scale
        s = 2 / (x * x + y * y + z * z + w * w)
        return cls(
            position,
            (
                (1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
                (s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)),
                (s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)),
            ),
        )

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """The rotation as a unit quaternion [x, y, z, w], camera to world.

        Shepperd's method divides by the largest of the four components, so that nothing cancels (J. Guidance and
        Control 1, 1978).
        """
        (a, b, c), (d, e, f), (g, h, i) = self.rotation
        x, y, z, w = 1 + a - e - i, 1 - a + e - i, 1 - a - e + i, 1 + a + e + i
        rows = ((x, b + d, c + g, h - f), (b + d, y, f + h, c - g), (c + g, f + h, z, d - b), (h - f, c - g, d - b, w))
        row = max(enumerate(rows), key=lambda item: item[1][item[0]])[1]
        length = math.hypot(*row)
        return (row[0] / length, row[1] / length, row[2] / length, row[3] / length)

    @classmethod
    def look_at(cls, position: Vector3, target: Vector3, up: Vector3) -> Pose:
        """Create a pose at `position` with `target` in the centre of the image and `up` pointing up.

        Raises ValueError if the target equals the position. If the view is along `up`, any level right-hand axis is
        used.
        """
        forward = _normalise(_subtract(target, position))
        right = _cross(forward, up)
        if math.hypot(*right) < 1e-6 * math.hypot(*up) or math.hypot(*up) == 0:
            right = _cross(forward, (0.0, 0.0, 1.0) if abs(forward[2]) < 0.9 else (1.0, 0.0, 0.0))
        right = _normalise(right)
        down = _cross(forward, right)
        return cls(
            position,
            (
                (right[0], down[0], forward[0]),
                (right[1], down[1], forward[1]),
                (right[2], down[2], forward[2]),
            ),
        )


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A pinhole camera's intrinsics for an image of `width` × `height`, all in pixels."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def resized(self, width: int, height: int) -> Intrinsics:
        """The same field of view and centre in an image of another size."""
        sx, sy = width / self.width, height / self.height
        return Intrinsics(self.fx * sx, self.fy * sy, self.cx * sx, self.cy * sy, width, height)

    def with_margins(self, margin_x: int, margin_y: int) -> Intrinsics:
        """The same view with `margin_x` more pixels on the left and right, and `margin_y` at the top and bottom."""
        return Intrinsics(
            self.fx, self.fy, self.cx + margin_x, self.cy + margin_y,
            self.width + 2 * margin_x, self.height + 2 * margin_y,
        )  # fmt: skip


def _subtract(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _cross(a: Vector3, b: Vector3) -> Vector3:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _normalise(a: Vector3) -> Vector3:
    length = math.hypot(*a)
    if length == 0:
        raise ValueError("a camera cannot look at its own position")
    return (a[0] / length, a[1] / length, a[2] / length)
