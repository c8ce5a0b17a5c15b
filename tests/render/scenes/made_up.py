"""A small made-up scene, with PlayCanvas' splat-transform's conversions of it in `files/`."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path

import numpy as np

from tests.render.arrays import gaussians_of
from tigas_render.gaussians import Gaussians

COUNT = 300
FILES = Path(__file__).parent / "files"


def shell(sh_degree: int = 1) -> Gaussians:
    """Discs on a sphere of radius 1 around the origin, coloured by where they are, and a little by where from."""
    turn = np.arange(COUNT) * math.pi * (3 - math.sqrt(5))
    y = 1 - 2 * (np.arange(COUNT) + 0.5) / COUNT
    radius = np.sqrt(1 - y**2)
    means = np.column_stack((radius * np.cos(turn), y, radius * np.sin(turn)))
    scales = np.column_stack((0.05 + 0.04 * np.abs(means[:, 0]), 0.06 + 0.02 * y**2, np.full(COUNT, 0.02)))
    # from z to the normal: half way between them is the axis of a half turn
    axis = means + np.array((0, 0, 1))
    quaternions = np.column_stack((np.zeros(COUNT), axis / np.linalg.norm(axis, axis=1, keepdims=True)))
    sh = np.zeros((COUNT, (sh_degree + 1) ** 2, 3))
    sh[:, 0] = 0.6 * means + 0.3
    for k in range(1, sh.shape[1]):
        sh[:, k] = 0.2 * np.sin(k + means)
    opacities = 0.55 + 0.4 * np.cos(3 * turn) ** 2
    return gaussians_of(means, scales, quaternions, opacities, sh)


def unzip(folder: Path, name: str = "shell.sog") -> Path:
    """The scene's SOG as a folder."""
    with zipfile.ZipFile(FILES / name) as bundle:
        bundle.extractall(folder)
    return folder
