"""What runs inside the lab: the services behind the gateway, and the shaper on it."""

from __future__ import annotations

import os
import subprocess
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import MappingProxyType

from tigas_common.errors import StartError
from tigas_common.processes import end, tigas
from tigas_common.topology import DASH, PAGE, SERVICES_VARIABLE, SHAPER, STORE, WEBTRANSPORT, page_services
from tigas_testbed.namespaces import SERVICE_ADDRESS, Lab, Role, check_rights

NAME = "lab"
FORWARDED = (PAGE, WEBTRANSPORT, DASH, STORE)
"""The ports of the services, which the gateway forwards."""
PORTS = (*FORWARDED, SHAPER)
"""All that a client reaches at the gateway."""
STOP_S = 3
"""A service that has not stopped by then is killed, in seconds."""


def render_command(scenes: Path | None) -> list[str]:
    """The render service, on all addresses of its namespace."""
    chosen = ("--scenes", str(scenes)) if scenes else ()
    return tigas("render", "--http", str(PAGE.everywhere), "--quic", str(WEBTRANSPORT.everywhere), *chosen)


def dash_command() -> list[str]:
    """The DASH packager beside the render service, whose views it does not get over the link."""
    return tigas("dash", "--render", f"http://{PAGE.loopback}", "--http", str(DASH.everywhere))


def store_command() -> list[str]:
    """The experiments' store, whose results are in the working directory unless its settings say otherwise."""
    return tigas("store", "--http", str(STORE.everywhere))


def shaper_command(*more: str) -> list[str]:
    """The shaper on the gateway, in front of the services."""
    forwards = (f"--forward={port.protocol}:{port.number}={SERVICE_ADDRESS}:{port.number}" for port in FORWARDED)
    interfaces = ("--access", "access", "--service", "service")
    return tigas("shaper", *interfaces, "--http", str(SHAPER.everywhere), *forwards, *more)


@contextmanager
def running(
    lab: Lab, role: Role, argv: list[str], environment: Mapping[str, str] = MappingProxyType({})
) -> Iterator[subprocess.Popen[bytes]]:
    """A process inside the lab for as long as the context lasts, with more in its environment."""
    process = subprocess.Popen(lab.command(role, argv), start_new_session=True, env=os.environ | environment)
    try:
        yield process
    finally:
        end(process, STOP_S)


def run_lab(*, scenes: Path | None, traces: Path | None, trace: str | None, stop: threading.Event) -> None:
    """Run the whole lab until `stop` is set. Raises StartError if it cannot start, or if a service of it ends."""
    check_rights()
    with ExitStack() as stack:
        lab = stack.enter_context(Lab(NAME).up(PORTS, host=True))
        options = [*(("--traces", str(traces)) if traces else ()), *(("--trace", trace) if trace else ())]
        environment = {SERVICES_VARIABLE: page_services(shaped=True)}
        services = {
            "shaper": stack.enter_context(running(lab, "gateway", shaper_command(*options))),
            "render service": stack.enter_context(running(lab, "service", render_command(scenes), environment)),
            "DASH packager": stack.enter_context(running(lab, "service", dash_command())),
            "experiments' store": stack.enter_context(running(lab, "service", store_command())),
        }
        while not stop.wait(0.2):
            for name, process in services.items():
                if process.poll() is not None:
                    raise StartError(f"The {name} has ended, so the lab ends too.")
