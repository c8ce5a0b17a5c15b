"""A host of the cluster: a `tigas render` on this machine, kept running as a child of this process."""

from __future__ import annotations

import os
import re
import subprocess
import threading
import time
from collections.abc import Sequence
from importlib.metadata import version
from typing import IO, TypedDict

from tigas_common.address import Address, is_address, is_loopback
from tigas_common.errors import StartError
from tigas_common.processes import Service, end_with_parent, keep_running, tigas_command

VIEWER_ADDRESS_VARIABLE = "TIGAS_VIEWER_ADDRESS"
"""Environment variable of a machine that viewers reach under another name or address than the cluster does."""
RETRY_S = 60.0
"""Seconds until a failing service is retried, as its machine may have recovered."""
OPEN_LINE = re.compile(r"Open http://[^/]+:([0-9]+)/")
"""Pattern of the last line of `tigas render`'s start message."""
OMITTED_PREFIXES = ("Preparing ", "Open to the network ")
"""Prefixes of output lines that are omitted, as they only help users at the machine's terminal."""


class Facts(TypedDict):
    """A host's report to the rest of the cluster, in a format that all versions understand."""

    version: str
    """Version of TIGAS."""
    address: str
    """Address of its machine within the cluster."""
    viewer_address: str
    """Name or address under which viewers reach it."""
    since: float
    """Start time, in seconds since 1970."""
    url: str | None
    """Its API over HTTP within the cluster; None while it is not serving."""
    said: list[str]
    """The start message of `tigas render`."""
    failure: str | None
    """Reason why it is not serving, if its last start failed."""


class Host:
    """Runs `tigas render` until `stop`. Ray runs it as an actor, and other processes call its methods through Ray."""

    def __init__(self, address: str | None, http_port: int, quic_port: int, options: Sequence[str]) -> None:
        """address: of this machine within the cluster; None for the one known to Ray. ports: 0 for any free one.
        options: further ones for `tigas render`.
        """
        if address is None:
            import ray.util

            address = ray.util.get_node_ip_address()
        self._address = address
        self._viewer_address = os.environ.get(VIEWER_ADDRESS_VARIABLE) or address
        everywhere = address if is_loopback(address) else "::" if ":" in address else "0.0.0.0"
        http, quic = Address(everywhere, http_port), Address(everywhere, quic_port)
        named = () if is_address(self._viewer_address) else ("--allow-host", self._viewer_address)
        fixed = ("--no-edit-scenes",)  # data stored by one host is missing on the others
        self._command = end_with_parent(
            tigas_command("render", "--http", str(http), "--quic", str(quic), *fixed, *named, *options)
        )
        self._since = time.time()
        self._render = _RenderOutput()
        self._failure: str | None = None
        self._stop = threading.Event()
        # The service ends with the thread that started it, so that it does not outlive this process if that is killed.
        self._keeping = threading.Thread(target=self._keep_running, name="keep the render service", daemon=True)
        self._keeping.start()

    def facts(self) -> Facts:
        render = self._render
        if render.port is not None:
            self._failure = None
        return Facts(
            version=version("tigas"),
            address=self._address,
            viewer_address=self._viewer_address,
            since=self._since,
            url=None if render.port is None else f"http://{Address(self._address, render.port)}",
            said=list(render.said),
            failure=self._failure,
        )

    def stop(self) -> None:
        """End the service, and wait until it has ended."""
        self._stop.set()
        self._keeping.join()

    def _keep_running(self) -> None:
        while not self._stop.is_set():
            try:
                keep_running((Service("render service", self._start),), self._stop)
            except StartError as error:
                self._failure = self._render.last or str(error)
                self._stop.wait(RETRY_S)

    def _start(self) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            self._command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"},  # Ray sets it to 1
        )
        self._render = _RenderOutput()
        threading.Thread(target=self._render.read, args=(process.stdout,), daemon=True).start()
        return process


class _RenderOutput:
    """Output of one start of the service."""

    def __init__(self) -> None:
        self.port: int | None = None
        """Port of its API while it is serving."""
        self.said: list[str] = []
        """Output until it started serving."""
        self.last = ""

    def read(self, output: IO[bytes]) -> None:
        """Read all output, and write it to the log."""
        with output:
            for line in output:
                text = line.decode(errors="replace").rstrip("\n")
                print(text, flush=True)
                self.last = text or self.last
                if opened := OPEN_LINE.match(text):
                    self.port = int(opened[1])
                elif self.port is None and not text.startswith(OMITTED_PREFIXES):
                    self.said.append(text)
        self.port = None
