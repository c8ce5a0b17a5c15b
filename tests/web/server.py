"""Starts and stops the services as a user would."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, Queue
from typing import Any, Self
from urllib.parse import urlsplit
from urllib.request import urlopen

TIGAS = (str(Path(sys.executable).with_name("tigas")),)
START_TIMEOUT = 90
"""Seconds; the first start on a machine compiles the rasteriser."""


class _Service:
    """A `tigas` command in a child process; a context manager that ends it."""

    announces: str
    """Pattern of its output when it serves; the group is its URL."""

    def __init__(
        self, *arguments: str, environment: dict[str, str] | None = None, program: Sequence[str] = TIGAS
    ) -> None:
        self._program = program
        self._arguments = arguments
        self._environment = environment or {}
        self.url = ""

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self) -> None:
        """Start and wait for the URL that it prints.

        Raises AssertionError with the service's output if it does not start.
        """
        self._process = subprocess.Popen(
            [*self._program, *self._arguments, *self._addresses()],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"} | self._environment,
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
        while not (found := re.search(self.announces, seen)):
            try:
                line = output.get(timeout=START_TIMEOUT)
            except Empty:
                line = None
            if line is None:
                self.stop()
                raise AssertionError(f"tigas {self._arguments[0]} did not start:\n{seen}")
            seen += line
        self.url = found[1]

    def kill(self) -> None:
        """As a machine that loses its power: no connection is closed."""
        self._process.kill()
        self._process.wait()

    @contextmanager
    def held(self) -> Iterator[None]:
        """As a machine that has no time for it: connections stay, and nothing is answered."""
        self._process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)

    def stop(self) -> None:
        """End it as Ctrl-C would."""
        self._process.terminate()
        self._process.wait(timeout=20)

    def _addresses(self) -> list[str]:
        raise NotImplementedError


class RenderServer(_Service):
    """`tigas render`, on free ports at first and on the same ones when it is started again."""

    announces = r"Open (http://\S+)"

    def __init__(
        self, *arguments: str, environment: dict[str, str] | None = None, program: Sequence[str] = TIGAS
    ) -> None:
        super().__init__("render", *arguments, environment=environment, program=program)
        self._http, self._quic = "127.0.0.1:0", "localhost:0"

    def start(self) -> None:
        """As any service; learns its ports."""
        super().start()
        with urlopen(f"{self.url}config.json") as answer:
            quic = urlsplit(json.load(answer)["webtransport_url"])
        self._http, self._quic = f"127.0.0.1:{urlsplit(self.url).port}", f"localhost:{quic.port}"

    def _addresses(self) -> list[str]:
        return ["--http", self._http, "--quic", self._quic]


class Packager(_Service):
    """`tigas dash`, for the render service that is at a URL when it starts; its own port is known before."""

    announces = r"DASH streams .* on (http://\S+)/"

    def __init__(self, *, idle_s: float = 60) -> None:
        """Usually, streams end on request before a test would have waited for them in vain."""
        super().__init__("dash", environment={"TIGAS_DASH_IDLE_S": str(idle_s)})
        self._http = _free_address()
        self.url = f"http://{self._http}"
        self.render = ""

    def sessions(self) -> list[dict[str, Any]]:
        """How every stream does."""
        with urlopen(f"{self.url}/sessions") as answer:
            streams: list[dict[str, Any]] = json.load(answer)
            return streams

    def _addresses(self) -> list[str]:
        return ["--render", self.render, "--http", self._http]


class Store(_Service):
    """`tigas store`, for the render service that is at a URL when it starts; its own port is known before."""

    announces = r"Experiments in .* on (http://\S+)/"

    def __init__(self, *arguments: str, **settings: object) -> None:
        super().__init__("store", *arguments)
        self._http = _free_address()
        self.url = f"http://{self._http}"
        self.configure(**settings)

    def configure(self, **settings: object) -> None:
        """Change settings for the next start."""
        known = {name: str(value) for name, value in settings.items() if value is not None}
        self._environment |= {f"TIGAS_STORE_{name.upper()}": value for name, value in known.items()}

    def _addresses(self) -> list[str]:
        return ["--http", self._http]


def _free_address() -> str:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return f"127.0.0.1:{free.getsockname()[1]}"
