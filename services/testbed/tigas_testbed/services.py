"""What runs inside the lab: the services behind the gateway, and the shaper on it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import MappingProxyType

from tigas_common.errors import StartError
from tigas_testbed.namespaces import SERVICE_ADDRESS, Lab, LocalPort, Role, check_rights

NAME = "lab"
PORTS = (
    LocalPort("tcp", 8080),
    LocalPort("udp", 4433),
    LocalPort("tcp", 8081),
    LocalPort("tcp", 8090),
    LocalPort("tcp", 8091),
)
"""The page, WebTransport, DASH, the shaper's API, and the experiments' store."""
SERVICES = {"TIGAS_RENDER_SERVICES": '{"dash": ":8081", "shaper": ":8090", "store": ":8091"}'}
"""Tells the page where the others are."""
STOP_S = 3
"""A service that has not stopped by then is killed, in seconds."""


def tigas(*arguments: str) -> list[str]:
    """A command line of the `tigas` that this process belongs to."""
    return [sys.executable, "-m", "tigas_common", *arguments]


def render_command(scenes: Path | None) -> list[str]:
    """The render service, on all addresses of its namespace."""
    chosen = ("--scenes", str(scenes)) if scenes else ()
    return tigas("render", "--http", "0.0.0.0:8080", "--quic", "0.0.0.0:4433", *chosen)


def dash_command() -> list[str]:
    """The DASH packager beside the render service, whose views it does not get over the link."""
    return tigas("dash", "--render", "http://127.0.0.1:8080", "--http", "0.0.0.0:8081")


def store_command() -> list[str]:
    """The experiments' store, whose results are in the working directory unless its settings say otherwise."""
    return tigas("store", "--http", "0.0.0.0:8091")


def shaper_command(*more: str) -> list[str]:
    """The shaper on the gateway, in front of the services."""
    forwards = tuple(f"{at.protocol}:{at.port}={SERVICE_ADDRESS}:{at.port}" for at in PORTS if at.port != 8090)
    flags = [argument for forward in forwards for argument in ("--forward", forward)]
    return tigas("shaper", "--access", "access", "--service", "service", "--http", "0.0.0.0:8090", *flags, *more)


@contextmanager
def running(
    lab: Lab, role: Role, argv: list[str], environment: Mapping[str, str] = MappingProxyType({})
) -> Iterator[subprocess.Popen[bytes]]:
    """A process inside the lab for as long as the context lasts, with more in its environment."""
    process = subprocess.Popen(lab.command(role, argv), start_new_session=True, env=os.environ | environment)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def run_lab(*, scenes: Path | None, traces: Path | None, trace: str | None, stop: threading.Event) -> None:
    """Run the whole lab until `stop` is set. Raises StartError if it cannot start, or if a service of it ends."""
    check_rights()
    with ExitStack() as stack:
        lab = stack.enter_context(Lab(NAME).up(PORTS, host=True))
        options = [*(("--traces", str(traces)) if traces else ()), *(("--trace", trace) if trace else ())]
        services = {
            "shaper": stack.enter_context(running(lab, "gateway", shaper_command(*options))),
            "render service": stack.enter_context(running(lab, "service", render_command(scenes), SERVICES)),
            "DASH packager": stack.enter_context(running(lab, "service", dash_command())),
            "experiments' store": stack.enter_context(running(lab, "service", store_command())),
        }
        while not stop.wait(0.2):
            for name, process in services.items():
                if process.poll() is not None:
                    raise StartError(f"The {name} has ended, so the lab ends too.")
