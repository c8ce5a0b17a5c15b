"""Which format a scene's file has, by its content: names may say anything."""

from __future__ import annotations

from pathlib import Path

from tigas_common.errors import BrokenScene
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.scenes.columns import Listener
from tigas_render.scenes.compressed_ply import is_compressed, read_compressed_ply
from tigas_render.scenes.lod_meta import LOD_META
from tigas_render.scenes.ply import read_ply
from tigas_render.scenes.ply_header import MAX_HEADER
from tigas_render.scenes.scene_file import SceneFile, read_start
from tigas_render.scenes.sog import read_sog
from tigas_render.scenes.sog_files import META, ZIP
from tigas_render.scenes.splat import looks_like_splat, read_splat
from tigas_render.scenes.spz import GZIP, MAGIC, read_spz
from tigas_render.scenes.streamed_sog import read_streamed_sog

ENDINGS = (".ply", ".sog", ".spz", ".splat")
"""Endings of files considered as scenes before their content is checked; among several files, the first ending wins."""


def ending_rank(path: Path) -> int:
    """Index of its ending in ENDINGS; their number if it has none of them."""
    ending = path.suffix.lower()
    return ENDINGS.index(ending) if ending in ENDINGS else len(ENDINGS)


def read_scene_file(path: Path) -> SceneFile:
    """Description of a file; a SOG scene of several files is its meta.json, a streamed one its lod-meta.json.

    Raises BrokenScene, with one sentence.
    """
    start, file_bytes = read_start(path, MAX_HEADER)
    if not start:
        raise BrokenScene(f"{path.name} is empty.")
    if start.startswith(b"ply"):
        return read_compressed_ply(path) if is_compressed(start) else read_ply(path)
    if start.startswith((GZIP, MAGIC)):
        return read_spz(path)
    if start.startswith(ZIP):
        return read_sog(path, bundled=True)
    if path.name == LOD_META:
        return read_streamed_sog(path)
    if path.name == META or start.lstrip().startswith(b"{"):
        return read_sog(path, bundled=False)
    if looks_like_splat(start, file_bytes):
        return read_splat(path)
    raise BrokenScene(f"{path.name} is no scene: it is neither PLY, SPZ, SOG nor .splat.")


def open_scene(path: Path, listener: Listener) -> Batches:
    """Open a scene in any format for reading. Opening and reading raise BrokenScene, with one sentence."""
    return read_scene_file(path).open(listener)


def load_scene(path: Path) -> Gaussians:
    """Read a scene in any format. Raises BrokenScene, with one sentence."""
    return read_scene_file(path).load()
