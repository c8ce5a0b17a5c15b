"""What runs inside the lab: the services behind the gateway, and the shaper on it; and the same without a lab."""

from __future__ import annotations

import os
import subprocess
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

from pydantic_settings import SettingsConfigDict

from tigas_common.address import ISOLATED
from tigas_common.commit import VARIABLE, this_commit
from tigas_common.processes import Service, keep_running, tigas
from tigas_common.settings import ServiceSettings, load_settings
from tigas_common.topology import DASH, PAGE, SERVICES_VARIABLE, SHAPER, STORE, WEBRTC, WEBTRANSPORT, page_services
from tigas_testbed.namespaces import SERVICE_ADDRESS, Lab, check_rights
from tigas_testbed.reach import own_code, reaching
from tigas_testbed.user import User

NAME = "lab"
FORWARDED = (PAGE, WEBTRANSPORT, DASH, WEBRTC, STORE)
"""The ports of the services, which the gateway forwards."""
PORTS = (*FORWARDED, SHAPER)
"""All that a client reaches at the gateway."""
TUN = Path("/dev/net/tun")
"""What the shaper's relay needs."""


def render_command(scenes: Path | None, ladder: str | None = None) -> list[str]:
    """The render service, on all addresses of its namespace."""
    chosen = [*(("--scenes", str(scenes)) if scenes else ()), *(("--ladder", ladder) if ladder else ())]
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


class _StoreSettings(ServiceSettings):
    """What the lab must know of the store's settings."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_STORE_", extra="ignore", frozen=True)
    table: ClassVar[str] = "store"

    results: Path = Path("results")


@dataclass(frozen=True, slots=True)
class Runner:
    """Runs services in a lab as an ordinary user."""

    lab: Lab
    user: User
    needed: Sequence[Path] = ()
    """Directories that they must reach, beside their own code."""
    environment: Mapping[str, str] = field(default_factory=dict)
    """More than this process has in its own."""

    def service(self, argv: Sequence[str]) -> list[str]:
        """A command line that runs a service. Raises StartError."""
        reached = reaching(self.user, (*own_code(), *self.needed), (), self.user.command(argv))
        return self.lab.command("service", reached)

    def shaper(self, *more: str) -> list[str]:
        """A command line that runs the shaper, which alone may change the network of its namespace, and go before other
        processes. Raises StartError.
        """
        argv = self.user.command(shaper_command(*more), ("net_admin", "sys_nice"))
        return self.lab.command("gateway", reaching(self.user, (*own_code(), *self.needed), (TUN,), argv))

    def start(
        self, command: Sequence[str], environment: Mapping[str, str] = MappingProxyType({})
    ) -> subprocess.Popen[bytes]:
        """Start such a command line as the leader of a session, with more in its environment."""
        own = {name: value for name, value in os.environ.items() if not name.startswith("XDG_")}  # root's directories
        return subprocess.Popen(
            command,
            start_new_session=True,
            env={**own, **self.user.environment(), ISOLATED: "yes", **self.environment, **environment},
        )


def run_lab(
    *, scenes: Path | None, traces: Path | None, trace: str | None, ladder: str | None, stop: threading.Event
) -> None:
    """Run the whole lab until `stop` is set. Raises StartError if it cannot start, or if a service ends too often."""
    check_rights()
    results = load_settings(_StoreSettings, {}).results
    caller, user = User.caller(os.environ), User.of_services(os.environ, Path.cwd())
    options = [*(("--traces", str(traces)) if traces else ()), *(("--trace", trace) if trace else ())]
    page = {SERVICES_VARIABLE: page_services(shaped=True)}
    render = render_command(scenes, ladder)
    with Lab(NAME).up(PORTS, host=True) as lab:
        user.give(results)
        needed = [each for each in (scenes, traces, results) if each is not None and each.is_dir()]
        runner = Runner(lab, user, needed, {VARIABLE: this_commit() or ""})  # git does not tell everybody
        try:
            keep_running(
                (
                    Service("shaper", lambda: runner.start(runner.shaper(*options))),
                    Service("render service", lambda: runner.start(runner.service(render), page)),
                    Service("DASH packager", lambda: runner.start(runner.service(dash_command()))),
                    Service("experiment store", lambda: runner.start(runner.service(store_command()))),
                ),
                stop,
            )
        finally:
            caller.give(results)


def run_demo(render_options: Sequence[str], stop: threading.Event) -> None:
    """Run the services on this machine, without a link between them and the page, until `stop` is set.

    Raises StartError as `run_lab` does.
    """

    def start(argv: Sequence[str]) -> subprocess.Popen[bytes]:
        environment = {SERVICES_VARIABLE: page_services(shaped=False)}
        return subprocess.Popen(argv, start_new_session=True, env=os.environ | environment)

    keep_running(
        (
            Service("DASH packager", lambda: start(tigas("dash"))),
            Service("experiment store", lambda: start(tigas("store"))),
            Service("render service", lambda: start(tigas("render", *render_options))),
        ),
        stop,
    )
