"""Changes that pages make to the models directory: adding uploads, and editing, renaming and removing scenes."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from tigas_common.errors import BrokenScene, DiskFull, Overloaded, TigasError
from tigas_common.files import NO_SPACE, storage_errors
from tigas_common.offload import Limit, Offload, offload_to_process
from tigas_common.wire.render import SceneEdit
from tigas_render.enhance.weights_store import WeightsStore
from tigas_render.scenes.directory import read_scene_file
from tigas_render.scenes.library_operations import SceneNotAdded, edit_scene, install_file, remove_scene, rename_scene
from tigas_render.scenes.registry import SceneRegistry
from tigas_render.settings import RenderSettings
from tigas_render.single_flight import SingleFlight
from tigas_render.uploads.parts import MODELS, ScenesReadOnly, Uploads, WrongOffset, open_uploads

_log = logging.getLogger(__name__)

CHECK_MEMORY = 500_000_000
"""Memory that the check of a file may use in addition to the upload limit, in bytes."""
CHECK_CPU_S = 600
"""CPU time limit of a check, in seconds: a hundred million Gaussians take less."""


class BuiltInScene(TigasError):
    """The scene is part of TIGAS."""

    status, type, title = 409, "built-in-scene", "The scene is built in"


class SceneLibrary:
    """Changes the models directory, and has the registry scan it again."""

    def __init__(
        self,
        settings: RenderSettings,
        registry: SceneRegistry,
        store: WeightsStore,
        offload: Offload = offload_to_process,
    ) -> None:
        """offload: runs the check of a file in another process."""
        self._settings = settings
        self._registry = registry
        self._weights = store
        self._offload = offload
        self._check_semaphore = asyncio.Semaphore(1)  # each may take as much memory as the largest scene
        self._additions = SingleFlight[str, str]()

    @property
    def max_upload_bytes(self) -> int | None:
        """Maximum size of an upload in bytes; None if pages may not change scenes."""
        try:
            return open_uploads(self._settings).limit
        except ScenesReadOnly:
            return None

    async def add(self, upload_id: str) -> str:
        """Check a complete upload, add it as a scene, and return its id. Repeated calls return the same id.

        Raises ScenesReadOnly, UnknownUpload, WrongOffset, BrokenScene, SceneNotAdded, TooCostly, DiskFull and
        StorageFailed.
        """
        uploads = open_uploads(self._settings)
        # A client that has disconnected may come back and repeat its request.
        return await self._additions.get(upload_id, lambda: self._add(uploads, upload_id))

    async def remove(self, scene_id: str) -> None:
        """Remove a scene for good. Raises ScenesReadOnly, UnknownScene, BuiltInScene, DiskFull and StorageFailed."""
        source = self._registry.source(scene_id)
        await self._change(scene_id, remove_scene)
        await asyncio.to_thread(self._weights.remove, source)

    async def rename(self, scene_id: str, name: str) -> None:
        """Change a scene's id. Raises the errors of `remove`, and SceneNotAdded for an id that is taken or invalid."""
        source = self._registry.source(scene_id)
        await self._change(scene_id, partial(rename_scene, name=name))
        await asyncio.to_thread(self._weights.rename, source, name)

    async def edit(self, scene_id: str, edit: SceneEdit) -> None:
        """Change a scene's description. Raises the errors of `remove`, and InvalidRequest for an invalid result."""
        await self._change(scene_id, partial(edit_scene, edit=edit))

    def expire_uploads(self) -> None:
        with suppress(ScenesReadOnly):
            open_uploads(self._settings).expire()

    async def _change(self, scene_id: str, change: Callable[[Path, str], None]) -> None:
        models = open_uploads(self._settings).models
        if self._registry.scene_info(scene_id).builtin:
            raise BuiltInScene(f"{self._registry.source(scene_id).name} is part of TIGAS and cannot be changed.")
        try:
            with storage_errors(MODELS):
                await asyncio.to_thread(change, models, scene_id)
        finally:
            await self._registry.scan()

    async def _add(self, uploads: Uploads, upload_id: str) -> str:
        upload = await asyncio.to_thread(uploads.get, upload_id)
        if upload.added:
            return upload.scene
        if upload.offset < upload.length:
            raise WrongOffset(f"The upload has {upload.offset} of {upload.length} bytes.")
        limit = Limit(memory=uploads.limit + CHECK_MEMORY, cpu_s=CHECK_CPU_S)
        try:
            async with self._check_semaphore:
                await self._offload(commit_upload, uploads, upload.id, limit=limit)
        except (Overloaded, DiskFull):  # a later attempt may succeed
            raise
        except TigasError as error:
            _log.warning("The upload of %s was refused: %s", upload.scene, error.detail)
            await asyncio.to_thread(uploads.discard, upload.id)
            raise
        _log.info("%s was uploaded: %.1f MB", upload.scene, upload.length / 1e6)
        await self._registry.scan()
        return upload.scene


def commit_upload(uploads: Uploads, id: str) -> None:
    """Check a complete upload, and add it as a scene unless that has been done already.

    Runs in a separate process because the file may be malicious. Raises UnknownUpload, SceneNotAdded, BrokenScene,
    DiskFull and MemoryError.
    """
    upload = uploads.get(id)
    try:
        with uploads.lock(upload):
            if uploads.get(id).added:  # by a check that outlived an earlier service
                return
            needed = read_scene_file(upload.path).packed_bytes
            if needed > uploads.limit:
                raise BrokenScene(
                    f"{upload.scene} takes {needed / 1e6:.1f} MB in memory, and all scenes together may take"
                    f" {uploads.limit / 1e6:.1f} MB."
                )
            uploads.mark_added(upload)
            install_file(upload.path, uploads.models, upload.scene)
    except OSError as error:
        if error.errno in NO_SPACE:
            raise DiskFull(f"There is not enough disk space for {upload.scene}; free some and try again.") from None
        raise SceneNotAdded(f"{upload.scene} could not be stored: {error.strerror or error}.") from None
    except RuntimeError as error:  # raised by PyTorch when it runs out of memory
        raise MemoryError from error
