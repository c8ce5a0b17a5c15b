"""A scene on offer: where its Gaussians come from, and what is known before they are loaded."""

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
    """Where a scene comes from and what is known of it before it is loaded."""

    id: str
    metadata: SceneMetadata
    version: str
    """Changes when the Gaussians may have changed."""
    open: Callable[[Listener], Batches] | None
    """Begins to read the Gaussians, which the listener hears of; None if the scene is broken. Raises BrokenScene, as
    reading may."""
    error: str | None = None
    """One sentence, if the scene is broken."""
    gaussians: int | None = None
    sh_degree: int | None = None
    file_bytes: int = 0
    format: str | None = None
    """Of the file, for people."""
    antialiased: bool = False
    """Whether it was trained with Mip-Splatting's 2D filter, as far as the file says."""
    digest: Callable[[], str] | None = None
    """The SHA-256 of the file, or one for all of several, in hexadecimal digits; None without any. Raises OSError."""
    memory_bytes: int = 0
    """An estimate of what it takes when loaded."""
    folder: Path | None = None
    """What lies beside it is its own; None if it is built in, or a file by itself."""
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
