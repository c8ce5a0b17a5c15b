"""Derived start views, kept in a directory so that each is computed once."""

from __future__ import annotations

import hashlib
from pathlib import Path

from tigas_common.errors import InvalidRequest
from tigas_common.files import read_regular
from tigas_common.parsing import parse
from tigas_render.local_files import write_to_cache
from tigas_render.scenes.source import SceneSource
from tigas_render.scenes.start_view.view import VERSION, StartView

MAX_BYTES = 10_000


class KeptViews:
    """Start views in `directory`, which is made when it is needed; a scene's folder is never written to."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def read(self, source: SceneSource) -> StartView | None:
        """The view of a scene; None if none is kept."""
        try:
            return parse(StartView, read_regular(self._path(source), MAX_BYTES))
        except (OSError, InvalidRequest):
            return None

    def write(self, source: SceneSource, view: StartView) -> None:
        """Keep the view of a scene, if that is possible."""
        write_to_cache(self._path(source), view.model_dump_json().encode())

    def _path(self, source: SceneSource) -> Path:
        """The file's name depends on everything that the view depends on."""
        key = f"{VERSION}|{source.version}|{source.metadata.up}"
        return self._directory / f"start-view-{hashlib.sha256(key.encode()).hexdigest()[:32]}.json"
