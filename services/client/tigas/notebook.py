"""Viewers in a notebook's cells."""

from __future__ import annotations

import os
import threading
from typing import TYPE_CHECKING, Any

from tigas.client import Client
from tigas.own_service import OwnService
from tigas_common.installation import explained

if TYPE_CHECKING:
    from tigas.widget import Viewer

_starting = threading.Lock()
_services: list[OwnService] = []


def show(
    scene: str | os.PathLike[str] | None = None, *, server: str | None = None, height: int = 480, **settings: Any
) -> Viewer:
    """Show a scene in a notebook's cell.

    The browser loads the viewer and its frames from the service, so it must reach the service. Without `server`, a
    service on the kernel's machine is started, which all cells share and which ends with the kernel: right if the
    browser runs there too, as with JupyterLab and VS Code on your own machine. With a kernel on another machine
    (JupyterHub, Colab), start `tigas render` where the browser reaches it, and pass its URL.

    Pages on `localhost` may use the service. Any other page, such as VS Code's (`vscode-webview://…`), must be allowed
    with the setting `allow_origins` of the service, also before it is started here:
    `TIGAS_RENDER_ALLOW_ORIGINS='["https://page.example"]'`. The cell names the origin if that is missing.

    Args:
        scene: Id of a scene; without `server`, also its file or folder. May be omitted if there is only one.
        server: URL of a running service.
        height: Height in CSS pixels.
        settings: `mode` and other settings of the viewer, such as `controller="fixed", profile=2`.

    Returns:
        A widget with `camera`, `scene` and `mode` to read and set; `close()` ends it.

    Raises ImportError without the extra `notebook`, StartError, FileNotFoundError and ClientError.
    """
    try:
        from tigas.widget import Viewer
    except ModuleNotFoundError as error:
        if (why := explained(error, ["notebook"])) is None:
            raise
        raise ImportError(str(why)) from None
    if server is None:
        service = _own_service()
        server, scene = service.url, service.load(scene)
    elif scene is None:
        with Client(server) as client:
            scene = client.scene().id
    mode = settings.pop("mode", "stateless")
    return Viewer(server=server.rstrip("/"), scene=str(scene), height=height, mode=mode, settings=settings)


def _own_service() -> OwnService:
    """The service that all cells share, started if there is none."""
    with _starting:
        if not (_services and _services[-1].runs):
            _services[:] = [OwnService()]
        return _services[0]
