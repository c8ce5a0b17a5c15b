"""An available scene: the source of its Gaussians, and facts known before they are loaded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tigas_common.errors import BrokenScene
from tigas_common.wire.render import Rung
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.scenes.columns import Listener
from tigas_render.scenes.metadata import SceneMetadata


@dataclass(frozen=True, slots=True)
class SceneSource:
    """Source and metadata of a scene that need not be loaded."""

    id: str
    metadata: SceneMetadata
    version: str
    """Changes when the Gaussians may have changed."""
    open: Callable[[Listener], Batches] | None
    """Starts reading the Gaussians, with a progress callback; None if the scene is broken. Both steps raise
    BrokenScene.
    """
    error: str | None = None
    """One sentence, if the scene is broken."""
    gaussians: int | None = None
    sh_degree: int | None = None
    file_bytes: int = 0
    format: str | None = None
    """Of the file, for people."""
    antialiased: bool = False
    """Whether it was trained with Mip-Splatting's 2D filter, if the file says so."""
    digest: Callable[[], str] | None = None
    """The SHA-256 of the file, or one for all of several, in hexadecimal digits; None if broken. Raises OSError."""
    memory_bytes: int = 0
    """Estimated memory when loaded."""
    folder: Path | None = None
    """Its own folder; None if it is built in, or a single file."""
    preview: Path | None = None
    """The picture that the scene brings along."""
    ladder: tuple[Rung, ...] | None = None
    """Its own quality levels, the best first; None if it has none."""

    @property
    def name(self) -> str:
        """For people."""
        return self.metadata.name or self.id

    def read(self, listener: Listener) -> Batches:
        """Begin to read the Gaussians. Raises BrokenScene, as reading may."""
        if self.open is None:
            raise BrokenScene(self.error or f"{self.name} cannot be loaded.")
        return self.open(listener)

    def load(self) -> Gaussians:
        """All Gaussians. Raises BrokenScene."""
        return self.read(lambda _: None).gathered()
