"""Scenes for the browser tests: a small one that renders fast, and a broken one."""

from __future__ import annotations

import json
import math
import random
from pathlib import Path

SMALL = "pebbles"
BROKEN = "broken-garden"

PROPERTIES = [
    *"xyz",
    *(f"scale_{i}" for i in range(3)),
    *(f"rot_{i}" for i in range(4)),
    "opacity",
    *(f"f_dc_{i}" for i in range(3)),
]
SH_BAND_0 = 0.28209479177387814


def write_scenes(directory: Path) -> None:
    """Make a models directory with the two scenes; the built-in one is always there."""
    broken = directory / BROKEN
    broken.mkdir()
    (broken / "point_cloud.ply").write_bytes(b"ply\nformat binary_little_endian 1.0\nelement vertex 10\nend_header\n")
    small = directory / SMALL
    small.mkdir()
    (small / "point_cloud.ply").write_text(_pebbles())
    camera = {"position": [0, 0, 0], "look_at": [0, 0, 4]}
    (small / "scene.json").write_text(json.dumps({"name": "Pebbles", "camera": camera}))


def write_antialiased_scene(directory: Path) -> None:
    """Put the scene `sand` there: grains that are smaller than pixels, trained with Mip-Splatting's filter."""
    (directory / "sand.ply").write_text(_pebbles(20_000, log_scale=-4.5, comment="SplatRenderMode: mip"))


def _pebbles(count: int = 2000, *, log_scale: float = -1.6, comment: str = "a test's scene") -> str:
    """Coloured pebbles all around the origin, so that every movement changes the picture."""
    rng = random.Random(7)
    rows = []
    for _ in range(count):
        x, y, z = (rng.gauss(0, 1) for _ in range(3))
        distance = rng.uniform(3, 6) / math.hypot(x, y, z)
        position = (x * distance, y * distance, z * distance)
        color = ((rng.random() - 0.5) / SH_BAND_0 for _ in range(3))
        rows.append(" ".join(f"{v:.4f}" for v in (*position, *[log_scale] * 3, 1, 0, 0, 0, 6, *color)))
    kind = ["ply", "format ascii 1.0", f"comment {comment}"]
    header = [*kind, f"element vertex {count}", *(f"property float {p}" for p in PROPERTIES)]
    return "\n".join([*header, "end_header", *rows, ""])
