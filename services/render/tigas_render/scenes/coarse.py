"""Coarse scenes, which stand in for large scenes during loading.

Most files have a coarse part that is quickly read (`SceneFile.coarse`). Of the others, a sample is kept in the cache
when they are loaded for the first time.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from tigas_render.local_files import write_to_cache
from tigas_render.raster.morton import morton_codes
from tigas_render.scenes.compressed_ply import read_compressed_ply, write_compressed_ply
from tigas_render.scenes.ply import ANTIALIASED
from tigas_render.scenes.scene_file import SceneFile, growth
from tigas_render.scenes.source import SceneSource
from tigas_render.scenes.start_view.statistics import SceneStatistics

LARGE = 1 << 19
"""Gaussians from which on a scene has a coarse one; fewer are loaded in about a second."""
VERSION = 1
"""Counts up when the sample changes, so that kept files are not taken for it."""


class CoarseScenes:
    """Kept samples in `directory`, which is made when it is needed."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def read(self, source: SceneSource) -> SceneFile | None:
        """The coarse part of a scene's file, or else the kept sample; None without both, if the scene is not large, and
        if the file was replaced.

        Raises BrokenScene and OSError.
        """
        if (source.gaussians or 0) < LARGE or not source.is_unchanged():
            return None
        path = self._path(source)
        return source.coarse() or (read_compressed_ply(path) if path.is_file() else None)

    def write(self, source: SceneSource, statistics: SceneStatistics) -> None:
        """Keep a sample of a large scene, if that is possible and its file is still the one that was read."""
        if statistics.count < LARGE or not source.is_unchanged():
            return
        sample = statistics.sample
        enlarged = replace(sample, scales=sample.scales * growth(statistics.count / len(sample)))
        order = np.argsort(morton_codes(sample.means), kind="stable")
        comments = [ANTIALIASED] if source.antialiased else []
        write_to_cache(self._path(source), lambda path: write_compressed_ply(path, enlarged, order, comments))

    def _path(self, source: SceneSource) -> Path:
        key = f"{VERSION}|{source.version}"
        return self._directory / f"coarse-{hashlib.sha256(key.encode()).hexdigest()[:32]}.ply"
