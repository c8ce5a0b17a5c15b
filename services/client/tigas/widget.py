"""The viewer in a notebook cell, an anywidget."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import anywidget
import traitlets

from tigas_common.pose import Pose


class Viewer(anywidget.AnyWidget):
    """A viewer in a notebook cell; `close()` ends it."""

    _esm = Path(__file__).with_name("widget.js")
    _camera = traitlets.Any(None).tag(sync=True)

    server = traitlets.Unicode().tag(sync=True)
    """URL of the service, reachable by the browser."""
    scene = traitlets.Unicode().tag(sync=True)
    """The scene's id."""
    mode = traitlets.Unicode("stateless").tag(sync=True)
    """How frames arrive: `stateless`, `video`, `dash`, `webrtc`, `side-by-side` or `local`."""
    settings = traitlets.Dict().tag(sync=True)
    """Other settings of the viewer, such as `{"controller": "fixed", "profile": 2}`."""
    height = traitlets.Int(480).tag(sync=True)
    """Height in CSS pixels; the width is the cell's."""
    camera = traitlets.Instance(Pose, allow_none=True)
    """Pose of the camera, which follows the user; set it to move the camera, or to None for the start view."""
    error = traitlets.Unicode().tag(sync=True)
    """Reason why there is no picture; empty otherwise."""

    @traitlets.observe("_camera")
    def _moved(self, change: Any) -> None:
        self.camera = _pose(change.new)

    @traitlets.observe("camera")
    def _aimed(self, change: Any) -> None:
        pose: Pose | None = change.new
        if pose != _pose(self._camera):  # otherwise the browser reported it
            self._camera = pose and {"position": list(pose.position), "quaternion": list(pose.quaternion)}


def _pose(camera: dict[str, Any] | None) -> Pose | None:
    return Pose.from_quaternion(tuple(camera["position"]), tuple(camera["quaternion"])) if camera else None
