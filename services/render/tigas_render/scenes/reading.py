"""Reads large scenes in a process of their own, at a low priority, so that frames of other scenes need not wait for
Python's lock, nor for a core.

As a program it is that process: its arguments are the descriptor of a pipe and the scene's file.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

from tigas_common.errors import BrokenScene
from tigas_common.processes import with_parent
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.scenes.coarse import LARGE
from tigas_render.scenes.directory import read_scene_file
from tigas_render.scenes.scene_file import Listener
from tigas_render.scenes.source import SceneSource

NICENESS = 5
"""On a processor that is always busy it then has a third of the share of others, and takes three times as long."""


def read(source: SceneSource, listener: Listener) -> Batches:
    """The Gaussians of a scene, as `SceneSource.read`, of a large file by another process.

    Reading raises BrokenScene, also if that process is killed, and OSError. An exception from `listener` ends it.
    """
    if source.file is None or source.gaussians is None or source.gaussians < LARGE:
        return source.read(listener)
    return Batches(source.gaussians, _received(source.file, listener))


def _received(path: Path, listener: Listener) -> Iterator[Gaussians]:
    reading, writing = os.pipe()
    with Connection(reading, writable=False) as connection:
        try:
            command = [sys.executable, "-m", __name__, str(writing), str(path)]
            process = subprocess.Popen(with_parent(command), pass_fds=[writing], stdin=subprocess.DEVNULL)
        finally:
            os.close(writing)
        with process:
            try:
                while (message := connection.recv()) is not None:
                    if isinstance(message, Exception):
                        raise message
                    if isinstance(message, float):
                        listener(message)
                    else:
                        yield message
            except EOFError:
                raise BrokenScene(f"{path.name} could not be read: the process that read it was ended.") from None
            finally:
                process.kill()


def _send(connection: Connection, path: Path) -> None:
    try:
        for part in read_scene_file(path).open(connection.send).parts:
            connection.send(part)
        connection.send(None)
    except (BrokenScene, OSError) as error:
        connection.send(error)


if __name__ == "__main__":
    with suppress(OSError):
        os.nice(NICENESS)
    with Connection(int(sys.argv[1]), readable=False) as pipe, suppress(BrokenPipeError):
        _send(pipe, Path(sys.argv[2]))
