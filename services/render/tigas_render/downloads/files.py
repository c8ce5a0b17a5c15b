"""The forms that a scene can be downloaded in, and how each is written."""

from __future__ import annotations

import hashlib
from pathlib import Path

from tigas_common.wire.render import DownloadForm, SceneDownload
from tigas_render.downloads.compressed_ply import write_compressed_ply
from tigas_render.downloads.order import Order
from tigas_render.scenes.ply import write_ply
from tigas_render.scenes.ply_header import ANTIALIASED
from tigas_render.scenes.source import SceneSource
from tigas_render.scenes.start_camera import derive_camera

FORMS: tuple[DownloadForm, ...] = ("ply", "compressed")
VERSION = 1
"""Counts up when the content of a form changes, so that files of before are not taken for it."""


def make(source: SceneSource, form: DownloadForm, path: Path) -> SceneDownload:
    """Write a scene's file in this form; what it takes in memory is what the scene's tensors take.

    Raises BrokenScene, and OSError if it cannot be written.
    """
    gaussians = source.load()
    metadata = source.metadata
    camera = metadata.camera or derive_camera(gaussians.means, gaussians.opacities, gaussians.scales, metadata.up)
    order = Order.of(gaussians, camera.position)
    comments = [*(part.comment for part in order.parts), *([ANTIALIASED] if gaussians.antialiased else ())]
    if form == "ply":
        write_ply(path, gaussians, order.indices, comments)
    else:
        order = order.with_neighbours_together(gaussians)
        write_compressed_ply(path, gaussians, order.indices, comments)
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    return SceneDownload(form=form, bytes=path.stat().st_size, sha256=sha256, gaussians=len(gaussians))
