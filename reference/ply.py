"""Writes scenes in INRIA's PLY format, which `tigas_render.scenes.ply` reads."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tigas_render.gaussians import Gaussians
from tigas_render.scenes.ply import REQUIRED, ply_header, rest_names
from tigas_render.scenes.scene_file import BLOCK


def write_ply(path: Path, gaussians: Gaussians, comments: Iterable[str] = ()) -> None:
    """Write a scene as a binary little-endian INRIA PLY; opacities are kept 1e-6 away from 0 and 1.

    comments: lines of the header. Needs a few megabytes of memory beyond the arrays.
    """
    degree = gaussians.sh_degree
    names = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", *rest_names(degree), *REQUIRED[6:])
    means, scales, quaternions, opacities, sh = gaussians.arrays
    with path.open("wb") as file:
        file.write(ply_header([("vertex", len(gaussians), "float", names)], comments))
        for start in range(0, len(gaussians), BLOCK):
            some = slice(start, start + BLOCK)
            opacity = opacities[some, None].clip(1e-6, 1 - 1e-6)
            rest = sh[some, 1:].transpose(0, 2, 1).reshape(len(opacity), -1)
            logit = np.log(opacity / (1 - opacity))
            parts = (
                means[some],
                sh[some, 0],
                rest,
                logit,
                np.log(scales[some].clip(np.finfo(np.float32).tiny)),
                quaternions[some],
            )
            file.write(np.concatenate(parts, axis=1, dtype="<f4").tobytes())
