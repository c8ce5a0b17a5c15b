"""Processes to monitor during a run: the browser's, and those of services on this machine."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from urllib.parse import urlsplit

import psutil

from tigas_common.address import is_loopback
from tigas_experiments.records.load import Processes, WatchedServices
from tigas_experiments.run.targets import Target

PROGRAMS = ("tigas", "tigas_common")
"""Names of the command as a script and as a module."""


@dataclass(frozen=True, slots=True)
class Watched:
    """The monitored processes of a run."""

    processes: Processes
    services: WatchedServices


def find_watched(target: Target) -> Watched:
    """Child processes, including browser and lab, and processes listening on the services' ports."""
    found = psutil.Process().children(recursive=True)
    services: WatchedServices = "threads"
    if target.lab is None:
        urls = [url for url in (target.url, target.shaper, target.dash) if url is not None]
        here = [url for url in urls if is_local(url)]
        ports = {_port(url) for url in here}
        listeners = _listeners(ports)
        if len(here) < len(urls):
            services = "elsewhere"
        elif listeners.keys() < ports:
            services = "processors"
        for listener in listeners.values():
            with suppress(psutil.Error):
                first = _root_process(listener)
                found += [first, *first.children(recursive=True)]
    return Watched({process: name for process in found if (name := _name(process)) is not None}, services)


def is_local(url: str) -> bool:
    """Whether a URL's host is this machine."""
    host = urlsplit(url).hostname or ""
    if is_loopback(host):
        return True
    own = {address.address.partition("%")[0] for card in psutil.net_if_addrs().values() for address in card}
    try:
        return any(str(address[0]) in own for *_, address in socket.getaddrinfo(host, None))
    except OSError:
        return False


def process_name(name: str, command: Sequence[str]) -> str:
    """Display name of a process: `tigas render`, `tigas_render.workers.edge` or `chromium renderer`."""
    for index, (word, following) in enumerate(pairwise(command)):
        if index <= 2 and Path(word).name in PROGRAMS:
            return f"tigas {following}"
        if word == "-m" and following not in PROGRAMS:
            return following
    kinds = (word.removeprefix("--type=") for word in command if word.startswith("--type="))
    return " ".join([name, *kinds])


def _name(process: psutil.Process) -> str | None:
    """Display name of a process; None if it has ended or access is denied."""
    with suppress(psutil.Error):
        return process_name(process.name(), process.cmdline())
    return None


def _root_process(process: psutil.Process) -> psutil.Process:
    """The parent process of a service with several processes, such as edges and engines. Raises psutil.Error."""
    for parent in process.parents():
        if not _is_ours(parent):
            break
        process = parent
    return process


def _is_ours(process: psutil.Process) -> bool:
    return (_name(process) or "").startswith("tigas")


def _port(url: str) -> int:
    parts = urlsplit(url)
    return parts.port or (443 if parts.scheme == "https" else 80)


def _listeners(ports: set[int]) -> dict[int, psutil.Process]:
    """TIGAS processes listening on these ports, as far as permissions allow, without container and network proxies."""
    found: dict[int, psutil.Process] = {}
    with suppress(psutil.Error):
        for connection in psutil.net_connections("tcp"):
            port = connection.laddr.port if connection.laddr else 0
            if connection.status == psutil.CONN_LISTEN and connection.pid is not None and port in ports:
                with suppress(psutil.Error):
                    if _is_ours(process := psutil.Process(connection.pid)):
                        found[port] = process
    return found
