"""The weights of networks, a scene's own or the general ones, and checks of whether they fit the scene."""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Literal

from tigas_common.errors import TigasError
from tigas_common.files import read_regular
from tigas_common.weights import FILE, MAX_BYTES, BrokenWeights, Weights, parse_weights
from tigas_common.wire.render import Rung
from tigas_render.scenes.source import SceneSource

GENERAL_FILE = Path(__file__).parent / "general.safetensors"

_log = logging.getLogger(__name__)


class NoWeights(TigasError):
    """There are no networks for the scene."""

    status, type, title = 404, "no-weights", "There are no such networks"


class ReadOnlyScene(TigasError):
    """The service has no permission to write next to the scene."""

    status, type, title = 409, "read-only-scene", "The scene's folder cannot be written"


class WeightsStore:
    """The available weights. Methods read files, so call them in a worker thread."""

    def __init__(self, ladder: Sequence[Rung], cache: Path, general: Path = GENERAL_FILE) -> None:
        """ladder: for scenes without their own."""
        self._ladder = ladder
        self._cache = cache / "enhance"
        self._general = general

    def path(self, source: SceneSource) -> Path:
        """Path of a scene's own weights, in its folder, or in the cache if it has no folder."""
        if source.folder is not None:
            return source.folder / FILE
        return self._cache / f"{source.id}.safetensors"

    def writable_path(self, source: SceneSource) -> Path:
        """Path of a scene's own weights, if it can be written. Raises ReadOnlyScene."""
        path = self.path(source)
        try:
            if source.folder is None:
                path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ReadOnlyScene(f"The folder {path.parent} cannot be created: {error.strerror or error}.") from None
        if not os.access(path.parent, os.W_OK):
            raise ReadOnlyScene(f"The service may not write into the folder of {source.name}.")
        return path

    def rename(self, source: SceneSource, id: str) -> None:
        """Keep a scene's own weights when its id changes. Weights in its folder have moved with the folder."""
        if source.folder is None:
            path = self.path(source)
            with suppress(OSError):  # most scenes have no weights
                path.replace(path.with_name(f"{id}.safetensors"))

    def remove(self, source: SceneSource) -> None:
        """Remove a removed scene's own weights. Weights in its folder were removed with the folder."""
        if source.folder is None:
            with suppress(OSError):  # most scenes have no weights, and this one has been removed already
                self.path(source).unlink()

    def kind(self, source: SceneSource) -> Literal["scene", "general"] | None:
        """The kind of networks that can enhance a scene's frames, if any."""
        if isinstance(self._own_weights(source), Weights):
            return "scene"
        general = self._load(self._general)
        fits = isinstance(general, Weights) and general.misfit(None, source.ladder or self._ladder) is None
        return "general" if fits else None

    def problem(self, source: SceneSource) -> str | None:
        """Why a scene's own weights are unusable; None if they are usable or missing."""
        own = self._own_weights(source)
        return own if isinstance(own, str) else None

    def read(self, source: SceneSource) -> bytes:
        """The content of a scene's own weights file. Raises NoWeights, and BrokenWeights if they do not fit."""
        own = self._own_weights(source)
        if own is None:
            raise NoWeights(f"{source.name} has no networks yet.")
        if isinstance(own, str):
            raise BrokenWeights(own)
        return _read_bytes(self.path(source))

    def read_general(self) -> bytes:
        """The content of the general weights file. Raises NoWeights."""
        if not self._general.is_file():
            raise NoWeights("There are no general networks.")
        return _read_bytes(self._general)

    def _own_weights(self, source: SceneSource) -> Weights | str | None:
        """A scene's own weights, or why they are unusable; None if there are no weights."""
        own = self._load(self.path(source))
        if isinstance(own, Weights):
            return own.misfit(_digest(source), source.ladder or self._ladder) or own
        return own

    def _load(self, path: Path) -> Weights | str | None:
        try:
            status = path.stat()
        except OSError:
            return None
        return _parse(path, status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=256)
def _parse(path: Path, size: int, modified_ns: int) -> Weights | str:
    """Parse a file, cached while its size and time stay the same. Returns the error's text if it is broken."""
    try:
        return parse_weights(_read_bytes(path))
    except BrokenWeights as error:
        _log.warning("%s: %s", path, error.detail)
        return error.detail


def _read_bytes(path: Path) -> bytes:
    try:
        return read_regular(path, MAX_BYTES)
    except OSError as error:
        raise BrokenWeights(f"The weights file cannot be read: {error.strerror or error}.") from None


def _digest(source: SceneSource) -> str | None:
    """The digest of the scene's file, which its own weights must match; None if the file cannot be read."""
    try:
        return None if source.digest is None else source.digest()
    except OSError:
        return None
