"""Coarse scenes, which stand in for large scenes while these are loading.

Most files have a coarse part that can be read quickly (`SceneFile.coarse`). For the others, a sample is cached when
they are loaded for the first time.
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
from tigas_render.scenes.scene_file import SceneFile, enlargement
from tigas_render.scenes.source import SceneSource
from tigas_render.scenes.start_view.statistics import SceneStatistics

MIN_GAUSSIANS = 1 << 19
"""Minimum number of Gaussians for a coarse scene; fewer are loaded in about a second."""
VERSION = 1
"""Version of the sample; increment it when samples change, so that old cached files are not used."""


class CoarseSceneCache:
    """A cache of samples in `directory`, which is created when needed."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def read(self, source: SceneSource) -> SceneFile | None:
        """The coarse part of a scene's file, or else the cached sample; None if there is neither, if the scene is not
        large, or if the file was replaced. Raises BrokenScene and OSError.
        """
        if (source.gaussians or 0) < MIN_GAUSSIANS or not source.is_unchanged():
            return None
        path = self._path(source)
        return source.coarse() or (read_compressed_ply(path) if path.is_file() else None)

    def write(self, source: SceneSource, statistics: SceneStatistics) -> None:
        """Cache a sample of a large scene, if possible, unless its file has changed since it was read."""
        if statistics.count < MIN_GAUSSIANS or not source.is_unchanged():
            return
        sample = statistics.sample
        enlarged = replace(sample, scales=sample.scales * enlargement(statistics.count / len(sample)))
        order = np.argsort(morton_codes(sample.means), kind="stable")
        comments = [ANTIALIASED] if source.antialiased else []
        write_to_cache(self._path(source), lambda path: write_compressed_ply(path, enlarged, order, comments))

    def _path(self, source: SceneSource) -> Path:
        key = f"{VERSION}|{source.version}"
        return self._directory / f"coarse-{hashlib.sha256(key.encode()).hexdigest()[:32]}.ply"
