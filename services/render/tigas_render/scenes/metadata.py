"""What is known of a scene beside its Gaussians: name, up, start camera and background."""

from __future__ import annotations

from tigas_common.wire import Point, StartCamera, Unit, WireModel


class SceneMetadata(WireModel):
    """The content of a scene.json; every field may be left out."""

    name: str | None = None
    up: Point = (0.0, -1.0, 0.0)
    camera: StartCamera | None = None
    background: tuple[Unit, Unit, Unit] = (0.0, 0.0, 0.0)
    """RGB, 0 to 1."""
