"""Scene files for tests, good and bad."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from tests.render.arrays import gaussians_of
from tigas_render.gaussians import Gaussians

NAMES = (
    *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)


def names(sh_degree: int) -> list[str]:
    """The properties that INRIA's trainer writes, in its order."""
    rest = [f"f_rest_{i}" for i in range(3 * ((sh_degree + 1) ** 2 - 1))]
    return [*NAMES[:9], *rest, *NAMES[9:]]


def header(properties: Sequence[str], count: int, format: str = "binary_little_endian") -> bytes:
    """A header; a property is `name` for a float, or `type name`."""
    lines = [f"property {'' if ' ' in name else 'float '}{name}" for name in properties]
    return "\n".join(["ply", f"format {format} 1.0", f"element vertex {count}", *lines, "end_header", ""]).encode()


def rows(count: int, sh_degree: int = 0, seed: int = 0) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    """Random values of every property, one row a Gaussian."""
    values = np.random.default_rng(seed).normal(size=(count, len(names(sh_degree))))
    return values.astype(np.float32)


def binary_ply(count: int = 3, sh_degree: int = 0) -> bytes:
    """A small sound file."""
    return header(names(sh_degree), count) + rows(count, sh_degree).tobytes()


def ascii_ply(count: int = 3, sh_degree: int = 0) -> bytes:
    """The same Gaussians as `binary_ply`, as text."""
    text = "\n".join(" ".join(repr(float(value)) for value in row) for row in rows(count, sh_degree))
    return header(names(sh_degree), count, "ascii") + text.encode() + b"\n"


def gaussians(count: int, sh_degree: int = 0, seed: int = 0) -> Gaussians:
    """Random Gaussians."""
    random = torch.Generator().manual_seed(seed)
    quaternions = torch.randn(count, 4, generator=random)
    return gaussians_of(
        means=torch.randn(count, 3, generator=random),
        scales=torch.rand(count, 3, generator=random) + 0.01,
        quaternions=quaternions / quaternions.norm(dim=1, keepdim=True),
        opacities=torch.rand(count, generator=random) * 0.98 + 0.01,
        sh=torch.randn(count, (sh_degree + 1) ** 2, 3, generator=random),
    )


def write(path: Path, content: bytes) -> Path:
    """Write a file and the folders that lead to it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path
