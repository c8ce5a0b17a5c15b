"""Viewers in notebook cells, and the render service that they share unless another is given."""

from __future__ import annotations

import atexit
import os
import re
import subprocess
import threading
from collections import deque
from concurrent.futures import Future
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from tigas.client import Client
from tigas_common.errors import StartError
from tigas_common.installation import missing_module_error, require_extras
from tigas_common.processes import STOP_S, run_process, tigas_command

if TYPE_CHECKING:
    from tigas.widget import Viewer

ANNOUNCED = re.compile(rb"Open (http://\S+)/")
START_S = 120
"""Timeout in seconds, as the first start on a machine compiles the rasteriser."""
LONGEST_NAME = 100
"""Maximum length of a scene's name derived from its file; a number may follow."""
_starting = threading.Lock()
_services: list[OwnService] = []


def show(
    scene: str | os.PathLike[str] | None = None, *, server: str | None = None, height: int = 480, **settings: Any
) -> Viewer:
    """Show a scene in a notebook cell.

    The browser loads the viewer and its frames from the service, so it must be able to reach the service. Without
    `server`, a service is started on the kernel's machine, shared by all cells and ended with the kernel. This works if
    the browser runs there too, as with JupyterLab and VS Code on your own machine. If the kernel runs on another
    machine (JupyterHub, Colab), start `tigas render` where the browser can reach it, and pass its URL.

    Pages on `localhost` may use the service. Any other page, such as VS Code's (`vscode-webview://…`), must be allowed
    with the service's setting `allow_origins`, before the service is started:
    `TIGAS_RENDER_ALLOW_ORIGINS='["https://page.example"]'`. If that is missing, the cell names the origin.

    Args:
        scene: Id of a scene or, without `server`, its file or folder. May be omitted if there is only one.
        server: URL of a running service.
        height: Height in CSS pixels.
        settings: `mode` and other settings of the viewer, such as `controller="fixed", profile=2`.

    Returns:
        A widget with readable and writable `camera`, `scene` and `mode`; `close()` ends it.

    Raises ImportError without the extra `notebook`, StartError, FileNotFoundError and ClientError.
    """
    try:
        from tigas.widget import Viewer
    except ModuleNotFoundError as error:
        if (why := missing_module_error(error, ["notebook"])) is None:
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
    """The service that all cells share, started on first use."""
    with _starting:
        if not (_services and _services[-1].runs):
            _services[:] = [OwnService()]
        return _services[0]


class OwnService:
    """`tigas render` on free ports, in a child process that ends with this one."""

    def __init__(self) -> None:
        """Start the service. Raises StartError."""
        require_extras("render")
        self._scenes = TemporaryDirectory(prefix="tigas-scenes-")
        self._ids: dict[Path, str] = {}
        self._url = Future[str]()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._run, name="tigas render", daemon=True)
        self._thread.start()
        try:
            self.url = self._url.result(START_S)
        except TimeoutError:
            if self._process is not None:
                self._process.terminate()
            raise StartError(f"The render service did not start within {START_S:.0f} s.") from None

    @property
    def runs(self) -> bool:
        return self._thread.is_alive()

    def load(self, scene: str | os.PathLike[str] | None) -> str:
        """Load a scene by its id, file or folder, and return its id.

        Raises FileNotFoundError and ClientError.
        """
        with Client(self.url) as client:
            if (path := _path(scene)) is None:
                return client.scene(str(scene) if scene else None).id
            id = self._id(path.resolve(strict=True))
            client.scenes(scan=True)
            return client.scene(id).id

    def _id(self, path: Path) -> str:
        """Id of a file or folder, which is linked into the models directory."""
        if path not in self._ids:
            name = re.sub(r"[^\w .()+-]", "-", path.name if path.is_dir() else path.stem)
            name = name.lstrip(" .()+-")[:LONGEST_NAME] or "scene"
            names = (name if number == 1 else f"{name}-{number}" for number in count(1))
            id = self._ids[path] = next(each for each in names if each not in self._ids.values())
            folder = Path(self._scenes.name, id)
            if path.is_dir():
                folder.symlink_to(path)
            else:
                folder.mkdir()
                (folder / path.name).symlink_to(path)
        return self._ids[path]

    def _run(self) -> None:
        """Run the process, which ends with this thread at the latest."""
        argv = tigas_command("render", "--http", "127.0.0.1:0", "--quic", "localhost:0", "--scenes", self._scenes.name)
        environment = os.environ | {"PYTHONUNBUFFERED": "1"}
        with ExitStack() as stack:
            options = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "env": environment}
            try:
                self._process = process = stack.enter_context(run_process(argv, STOP_S, **options))
            except OSError as error:
                self._url.set_exception(StartError(f"The render service cannot be started: {error}."))
                return
            atexit.register(process.terminate)  # on systems that do not end it with the thread
            output = iter(process.stdout or ())
            started = deque[bytes](maxlen=1)
            for line in output:
                started.append(line)
                if found := ANNOUNCED.search(line):
                    self._url.set_result(found[1].decode())
                    break
            else:
                self._url.set_exception(StartError(b"".join(started).decode(errors="replace").strip()))
            deque(output, maxlen=0)


def _path(scene: str | os.PathLike[str] | None) -> Path | None:
    """A scene's path; None if it is an id: neither a folder nor a name with a file suffix."""
    path = Path(scene or "")
    return path if isinstance(scene, os.PathLike) or path.suffix or path.name != (scene or "") else None
