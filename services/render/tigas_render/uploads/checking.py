"""Checks an upload that is whole, and makes it a scene: in a process of its own, as the file may be hostile."""

from __future__ import annotations

from tigas_common.errors import BrokenScene
from tigas_render.scenes.directory import scene_file
from tigas_render.scenes.library_operations import NotAdded, keep
from tigas_render.uploads.parts import Uploads


def keep_upload(uploads: Uploads, id: str) -> None:
    """Make an upload a scene, unless it is one already. Raises UnknownUpload, NotAdded, BrokenScene and MemoryError."""
    upload = uploads.get(id)
    try:
        with uploads.locked(upload):
            if uploads.get(id).added:  # by a check that outlived its service
                return
            needed = scene_file(upload.path).packed_bytes
            if needed > uploads.limit:
                raise BrokenScene(
                    f"{upload.scene} takes {needed / 1e6:.1f} MB in memory, and all scenes together may take"
                    f" {uploads.limit / 1e6:.1f} MB."
                )
            uploads.note_adding(upload)
            keep(upload.path, uploads.models, upload.scene)
    except OSError as error:
        raise NotAdded(f"{upload.scene} could not be kept: {error.strerror or error}.") from None
    except RuntimeError as error:  # PyTorch's for a lack of memory
        raise MemoryError from error
