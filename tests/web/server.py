"""Starts and stops `tigas render` as a user would."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
from pathlib import Path
from queue import Empty, Queue
from typing import Self
from urllib.parse import urlsplit
from urllib.request import urlopen

START_TIMEOUT = 90
"""Seconds; the first start on a machine compiles the rasteriser."""


class RenderServer:
    """The service in a process of its own; a context manager that ends it."""

    def __init__(self, *arguments: str) -> None:
        self._arguments = arguments
        self._http, self._quic = "127.0.0.1:0", "[::]:0"
        self.url = ""

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self) -> None:
        """Start on free ports, or again on those of the first time, and wait for the URL that it prints.

        Raises AssertionError with the server's output if it does not start.
        """
        self._process = subprocess.Popen(
            [
                str(Path(sys.executable).with_name("tigas")),
                "render",
                *self._arguments,
                "--http",
                self._http,
                "--quic",
                self._quic,
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )
        output: Queue[str | None] = Queue()
        stream = self._process.stdout
        assert stream is not None

        def pump() -> None:
            with stream:
                for line in stream:
                    output.put(line)
            output.put(None)

        threading.Thread(target=pump, daemon=True).start()
        seen = ""
        while not (found := re.search(r"Open (http://\S+)", seen)):
            try:
                line = output.get(timeout=START_TIMEOUT)
            except Empty:
                line = None
            if line is None:
                self.stop()
                raise AssertionError(f"tigas render did not start:\n{seen}")
            seen += line
        self.url = found[1]
        with urlopen(f"{self.url}config.json") as answer:
            quic = urlsplit(json.load(answer)["webtransport_url"])
        self._http, self._quic = f"127.0.0.1:{urlsplit(self.url).port}", f"[::]:{quic.port}"

    def kill(self) -> None:
        """As a machine that loses its power: no connection is closed."""
        self._process.kill()
        self._process.wait()

    def stop(self) -> None:
        """End it as Ctrl-C would."""
        self._process.terminate()
        self._process.wait(timeout=20)
