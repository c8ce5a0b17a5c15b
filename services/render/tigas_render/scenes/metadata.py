"""Metadata of a scene: name, up, start camera and background, from its scene.json."""

from __future__ import annotations

from pathlib import Path
from typing import Self

from pydantic import Field, field_validator, model_validator

from tigas_common.errors import BrokenScene, InvalidRequest
from tigas_common.files import open_regular
from tigas_common.parsing import MAX_BODY, parse
from tigas_common.wire.model import Point, Unit, WireModel
from tigas_common.wire.render import StartCamera

METADATA = "scene.json"
"""Its name in a scene's folder."""
DEFAULT_UP: Point = (0.0, -1.0, 0.0)
"""Captures have OpenCV's axes: y points down."""
SHORTEST_UP = 1e-6
"""Smallest longest component: the square of a much shorter vector underflows to 0."""


class SceneMetadata(WireModel):
    """The content of a scene.json; every field may be left out."""

    name: str | None = Field(default=None, min_length=1, max_length=128)
    up: Point = DEFAULT_UP
    camera: StartCamera | None = None
    background: tuple[Unit, Unit, Unit] = (0.0, 0.0, 0.0)
    """RGB, 0 to 1."""

    @field_validator("up")
    @classmethod
    def _check_up(cls, up: Point) -> Point:
        if max(map(abs, up)) < SHORTEST_UP:
            raise ValueError("a vector of length zero points nowhere")
        return up

    @model_validator(mode="after")
    def _check_camera(self) -> Self:
        if self.camera is not None and self.camera.position == self.camera.look_at:
            raise ValueError("a camera cannot look at its own position")
        return self


def read_metadata(scene: Path) -> SceneMetadata:
    """Read the scene.json in a scene's folder; without one, or for a single file, all fields have their defaults.

    Raises BrokenScene with one sentence on the problem.
    """
    path = scene / METADATA
    try:
        with open_regular(path) as file:
            content = file.read(MAX_BODY + 1)
    except (FileNotFoundError, NotADirectoryError):
        return SceneMetadata()
    except OSError as error:
        raise BrokenScene(f"{path.name} cannot be read: {error.strerror or error}.") from None
    if len(content) > MAX_BODY:
        raise BrokenScene(f"{path.name} is larger than {MAX_BODY // 1024} KiB.")
    try:
        return parse(SceneMetadata, content)
    except InvalidRequest as error:
        raise BrokenScene(f"{path.name} is not valid: {error.detail}") from None
