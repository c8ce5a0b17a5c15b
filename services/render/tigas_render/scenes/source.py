"""An available scene: the source of its Gaussians, and facts known before they are loaded.

A scene's folder may have a scene.json with metadata, and a ladder.json with quality levels; both are read strictly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Self, TypeVar

from pydantic import Field, field_validator, model_validator

from tigas_common.errors import BrokenScene, InvalidRequest
from tigas_common.files import open_regular
from tigas_common.parsing import parse
from tigas_common.wire.model import Entries, Point, Unit, WireModel
from tigas_common.wire.render import MAX_PATHS, MAX_VIEWS, Rung, SavedName, SavedPath, SavedView, StartCamera
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.scenes.scene_file import Listener, SceneFile, explained

METADATA, LADDER = "scene.json", "ladder.json"
"""Names in a scene's folder."""
DEFAULT_UP: Point = (0.0, -1.0, 0.0)
"""Captures have OpenCV's axes: y points down."""
SHORTEST_UP = 1e-6
"""Smallest longest component: the square of a much shorter vector underflows to 0."""
MAX_RUNGS = 16
MAX_METADATA = 1 << 20
"""The largest scene.json or ladder.json, in bytes: with room for all views and paths that a scene may have."""

Content = TypeVar("Content", bound=WireModel)


class SceneMetadata(WireModel):
    """The content of a scene.json; every field may be left out."""

    name: str | None = Field(default=None, min_length=1, max_length=128)
    up: Point | None = None
    camera: StartCamera | None = None
    background: tuple[Unit, Unit, Unit] = (0.0, 0.0, 0.0)
    """RGB, 0 to 1."""
    views: dict[SavedName, SavedView] = Field(default_factory=dict)
    paths: dict[SavedName, SavedPath] = Field(default_factory=dict)

    @property
    def look(self) -> str:
        """All that its pictures and downloads depend on, as a part of their keys in caches."""
        return self.model_dump_json(exclude={"views", "paths"})

    @field_validator("up")
    @classmethod
    def _check_up(cls, up: Point | None) -> Point | None:
        if up is not None and max(map(abs, up)) < SHORTEST_UP:
            raise ValueError("a vector of length zero points nowhere")
        return up

    @model_validator(mode="after")
    def _check_camera(self) -> Self:
        if self.camera is not None and self.camera.position == self.camera.look_at:
            raise ValueError("a camera cannot look at its own position")
        return self

    @model_validator(mode="after")
    def _check_saved(self) -> Self:
        if len(self.views) > MAX_VIEWS or len(self.paths) > MAX_PATHS:
            raise ValueError(f"a scene has at most {MAX_VIEWS} saved views and {MAX_PATHS} paths")
        return self


class LadderFile(WireModel):
    """The content of a ladder.json, which `tigas scene ladder` writes."""

    rungs: Annotated[Entries[Rung], Field(min_length=1, max_length=MAX_RUNGS)]
    """The best first."""
    views: int | None = Field(default=None, ge=1)
    """How many views of the scene it was measured on."""
    version: str | None = Field(default=None, max_length=100)
    """Of TIGAS, when it was measured."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len({rung.name for rung in self.rungs}) < len(self.rungs):
            raise ValueError("two rungs have the same name")
        for better, worse in pairwise(self.rungs):
            if worse.expected_kb >= better.expected_kb:
                raise ValueError(f"{worse.name!r} must have smaller frames than {better.name!r} before it")
            if worse.psnr_db is not None and better.psnr_db is not None and worse.psnr_db >= better.psnr_db:
                raise ValueError(f"{worse.name!r} cannot be better than {better.name!r} before it")
        return self


def read_metadata(scene: Path) -> SceneMetadata:
    """Read the scene.json of a folder, or the NAME.scene.json next to a single file; all fields have defaults.

    Raises BrokenScene with one sentence on the problem.
    """
    return _read_json(metadata_path(scene), SceneMetadata) or SceneMetadata()


def metadata_path(scene: Path) -> Path:
    """Place of the metadata of a scene's folder or single file."""
    return scene / METADATA if scene.is_dir() else scene.with_name(f"{scene_id(scene)}.{METADATA}")


def scene_id(path: Path) -> str:
    """Id of a single-file scene: its name without the ending."""
    return path.stem.removesuffix(".compressed")


def read_ladder(scene: Path) -> tuple[Rung, ...] | None:
    """The rungs in the ladder.json of a scene's folder; None without one. Raises BrokenScene like `read_metadata`."""
    ladder = _read_json(scene / LADDER, LadderFile)
    return None if ladder is None else ladder.rungs


def _read_json(path: Path, kind: type[Content]) -> Content | None:
    with explained(path):
        try:
            with open_regular(path) as file:
                content = file.read(MAX_METADATA + 1)
        except (FileNotFoundError, NotADirectoryError):
            return None
    if len(content) > MAX_METADATA:
        raise BrokenScene(f"{path.name} is larger than {MAX_METADATA // 1024} KiB.")
    try:
        return parse(kind, content, MAX_METADATA)
    except InvalidRequest as error:
        raise BrokenScene(f"{path.name} is not valid: {error.detail}") from None


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
    is_unread: bool = False
    """Whether that is because a file that is there could not be read this time."""
    gaussians: int | None = None
    sh_degree: int | None = None
    file_bytes: int = 0
    format: str | None = None
    """Of the file, for people."""
    antialiased: bool = False
    """Whether it was trained with Mip-Splatting's 2D filter, if the file says so."""
    digest: Callable[[], str] | None = None
    """The SHA-256 of the file, or one for all of several, in hexadecimal digits; None if broken. Raises OSError."""
    is_unchanged: Callable[[], bool] = lambda: True
    """Whether the file is still of this version."""
    coarse: Callable[[], SceneFile | None] = lambda: None
    """As SceneFile has it."""
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
        return self.metadata.name or self.id

    def read(self, listener: Listener) -> Batches:
        """Begin to read the Gaussians. Raises BrokenScene, as reading may."""
        if self.open is None:
            raise BrokenScene(self.error or f"{self.name} cannot be loaded.")
        return self.open(listener)

    def load(self) -> Gaussians:
        """All Gaussians. Raises BrokenScene."""
        return self.read(lambda _: None).gathered()
