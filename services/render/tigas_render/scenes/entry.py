"""The state of an available scene: whether it is loaded, its users, and its memory."""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass
from urllib.parse import quote

from tigas_common.errors import Overloaded, TigasError
from tigas_common.wire.render import Rung, SceneInfo, StartCamera
from tigas_render.raster.base import PreparedScene
from tigas_render.scenes.source import DEFAULT_UP, SceneSource
from tigas_render.scenes.start_view.view import StartView, view_from_metadata


@dataclass(frozen=True, slots=True)
class LoadedScene:
    """A scene in memory."""

    source: SceneSource
    prepared: PreparedScene
    gaussians: int
    view: StartView
    """From the scene's metadata, or derived from its Gaussians."""
    is_coarse: bool = False
    """Whether this is a coarse stand-in for a scene that is still loading."""

    @property
    def camera(self) -> StartCamera:
        return self.view.camera

    @property
    def background(self) -> tuple[float, float, float]:
        """RGB, 0 to 1."""
        return self.source.metadata.background

    @property
    def ladder(self) -> tuple[Rung, ...] | None:
        return self.source.ladder


class LoadingEnded(Overloaded):
    """The loading of a scene was aborted."""


class Entry:
    """A scene's changing state."""

    def __init__(self, source: SceneSource) -> None:
        self.source = source
        self.error = source.error
        self.loaded: LoadedScene | None = None
        self.loading: asyncio.Task[TigasError | None] | None = None
        self.coarse_settled = asyncio.Event()
        """Set once the coarse scene is available or known to be missing, or loading has ended."""
        self.coarse: LoadedScene | None = None
        """The coarse scene, while this one is loading."""
        self.reserved = 0
        """Bytes that the scene takes, or will take once it is loaded."""
        self.is_queued = False
        """Whether loading waits until other scenes have been read."""
        self.sha256: str | None = None
        """The SHA-256 of the file that was loaded last."""
        self.view: StartView | None = view_from_metadata(source.metadata)
        """The start view, if it is known without loading the scene or the scene was loaded before."""
        self.users = 0
        self.last_used = 0.0
        self.last_viewed = -math.inf
        self.unload_when_unused = False
        """Whether to unload the scene once it is unused."""
        self.progress = 0.0
        """The share that has been read, 0 to 1, while the scene is loading."""

    def available(self, *, coarse: bool) -> LoadedScene | None:
        """The loaded scene, or with `coarse` perhaps the coarse one; None if it must be loaded first."""
        return self.loaded or (self.coarse if coarse else None)

    def info(self, *, builtin: bool) -> SceneInfo:
        """The scene's description for clients."""
        source, loaded = self.source, self.loaded
        return SceneInfo(
            id=source.id,
            name=source.name,
            state="loaded" if loaded else "loading" if self.loading else "broken" if self.error else "unloaded",
            error=self.error,
            progress=self.progress if self.loading else None,
            gaussians=loaded.gaussians if loaded else source.gaussians,
            sh_degree=source.sh_degree,
            file_bytes=source.file_bytes,
            file_sha256=self.sha256,
            format=source.format,
            antialiased=source.antialiased,
            memory_bytes=loaded.prepared.nbytes if loaded else 0,
            preview=f"/scenes/{quote(source.id)}/preview",
            up=source.metadata.up or (self.view.up if self.view else DEFAULT_UP),
            camera=self.view.camera if self.view else None,
            background=source.metadata.background,
            ladder=source.ladder,
            views=source.metadata.views,
            paths=source.metadata.paths,
            builtin=builtin,
        )
