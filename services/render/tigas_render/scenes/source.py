"""An available scene: the source of its Gaussians, and everything known before they are loaded.

A scene's folder may have a scene.json with metadata and a ladder.json with quality levels. Both are parsed strictly.
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
from tigas_render.scenes.scene_file import Listener, SceneFile, translate_os_errors

METADATA, LADDER = "scene.json", "ladder.json"
"""File names in a scene's folder."""
DEFAULT_UP: Point = (0.0, -1.0, 0.0)
"""The usual up axis of captures, which have OpenCV's axes: y points down."""
MIN_UP_LENGTH = 1e-6
"""Minimum length of an up vector's largest component; the square of a much shorter vector underflows to 0."""
MAX_RUNGS = 16
MAX_METADATA = 1 << 20
"""Maximum size of a scene.json or ladder.json in bytes, enough for all views and paths that a scene may have."""

Content = TypeVar("Content", bound=WireModel)


class SceneMetadata(WireModel):
    """The content of a scene.json. All fields are optional."""

    name: str | None = Field(default=None, min_length=1, max_length=128)
    up: Point | None = None
    camera: StartCamera | None = None
    background: tuple[Unit, Unit, Unit] = (0.0, 0.0, 0.0)
    """RGB, 0 to 1."""
    views: dict[SavedName, SavedView] = Field(default_factory=dict)
    paths: dict[SavedName, SavedPath] = Field(default_factory=dict)

    @property
    def appearance_key(self) -> str:
        """All metadata that images and downloads depend on, as a part of their cache keys."""
        return self.model_dump_json(exclude={"views", "paths"})

    @field_validator("up")
    @classmethod
    def _check_up(cls, up: Point | None) -> Point | None:
        if up is not None and max(map(abs, up)) < MIN_UP_LENGTH:
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
    """Quality levels, the best first."""
    views: int | None = Field(default=None, ge=1)
    """Number of views of the scene on which they were measured."""
    version: str | None = Field(default=None, max_length=100)
    """Version of TIGAS that measured them."""

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
    """Read the scene.json of a folder, or the NAME.scene.json next to a single file; defaults if there is no such file.

    Raises BrokenScene, with one sentence.
    """
    return _read_json(metadata_path(scene), SceneMetadata) or SceneMetadata()


def metadata_path(scene: Path) -> Path:
    """Path of the metadata of a scene's folder or single file."""
    return scene / METADATA if scene.is_dir() else scene.with_name(f"{scene_id(scene)}.{METADATA}")


def scene_id(path: Path) -> str:
    """Id of a single-file scene: the file's name without its ending."""
    return path.stem.removesuffix(".compressed")


def read_ladder(scene: Path) -> tuple[Rung, ...] | None:
    """Read the rungs in a scene folder's ladder.json; None without one. Raises BrokenScene, with one sentence."""
    ladder = _read_json(scene / LADDER, LadderFile)
    return None if ladder is None else ladder.rungs


def _read_json(path: Path, kind: type[Content]) -> Content | None:
    with translate_os_errors(path):
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
    """The source and metadata of a scene, whether or not it is loaded."""

    id: str
    metadata: SceneMetadata
    version: str
    """A string that changes when the Gaussians may have changed."""
    open: Callable[[Listener], Batches] | None
    """Opens the Gaussians for reading, with a progress callback; None if the scene is broken. Raises BrokenScene, as
    does reading them.
    """
    error: str | None = None
    """Why the scene is broken, in one sentence; None if it is not."""
    is_unread: bool = False
    """Whether it is broken only because an existing file could not be read this time."""
    gaussians: int | None = None
    sh_degree: int | None = None
    file_bytes: int = 0
    format: str | None = None
    """The file format's name, for display."""
    antialiased: bool = False
    """Whether the scene was trained with Mip-Splatting's 2D filter, according to the file."""
    digest: Callable[[], str] | None = None
    """The SHA-256 of the file or of all files together, in hexadecimal; None if broken. Raises OSError."""
    is_unchanged: Callable[[], bool] = lambda: True
    """Whether the file still has this version."""
    coarse: Callable[[], SceneFile | None] = lambda: None
    """Describes a small part that shows the whole scene, like `SceneFile.coarse`."""
    memory_bytes: int = 0
    """Estimated memory of the loaded scene."""
    folder: Path | None = None
    """The scene's own folder; None if it is built in or a single file."""
    preview: Path | None = None
    """The preview image that comes with the scene."""
    ladder: tuple[Rung, ...] | None = None
    """The scene's own quality levels, the best first, if any."""

    @property
    def name(self) -> str:
        return self.metadata.name or self.id

    def read(self, listener: Listener) -> Batches:
        """Open the Gaussians for reading. Raises BrokenScene, as does reading them."""
        if self.open is None:
            raise BrokenScene(self.error or f"{self.name} cannot be loaded.")
        return self.open(listener)

    def load(self) -> Gaussians:
        """Read and return all Gaussians. Raises BrokenScene."""
        return self.read(lambda _: None).read_all()
