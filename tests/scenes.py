"""Scenes that need no loading, and the configuration of a service."""

from __future__ import annotations

from typing import Any

from tigas_common.wire.render import DEFAULT_LADDER, SceneInfo, ServerConfig, StartCamera

ALONE = ServerConfig(
    version="0", ladder=DEFAULT_LADDER, certificate_sha256=None, webtransport_url=None, https_url=None, services={}
)
"""Of a service that is no cluster's."""


def scene(
    up: tuple[float, float, float] = (0.0, -1.0, 0.0), camera: StartCamera | None = None, **changes: Any
) -> SceneInfo:
    """A loaded one, with changes."""
    made = SceneInfo(
        id="s",
        name="s",
        state="loaded",
        error=None,
        gaussians=1,
        sh_degree=0,
        file_bytes=1,
        file_sha256="0" * 64,
        memory_bytes=1,
        preview="",
        up=up,
        camera=camera,
        background=(0, 0, 0),
    )
    return made.model_copy(update=changes)
