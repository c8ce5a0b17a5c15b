"""What runs inside the lab: the services behind the gateway, and the shaper on it; and the same without a lab."""

from __future__ import annotations

import os
import socket
import subprocess
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

from pydantic_settings import SettingsConfigDict

from tigas_common.address import ISOLATED, Address
from tigas_common.commit import VARIABLE, this_commit
from tigas_common.errors import StartError
from tigas_common.hosts import host_of
from tigas_common.processes import Service, keep_running, tigas
from tigas_common.settings import MODELS, ServiceSettings, load_settings
from tigas_common.topology import (
    DASH,
    PAGE,
    SERVICES_VARIABLE,
    SHAPER,
    STORE,
    UPSTREAMS_VARIABLE,
    WEBRTC,
    WEBTRANSPORT,
    Port,
    page_services,
    upstreams,
)
from tigas_testbed.namespaces import GATEWAY_SERVICE_ADDRESS, SERVICE_ADDRESS, Lab, check_rights
from tigas_testbed.reach import own_code, reaching
from tigas_testbed.user import User

NAME = "lab"
FORWARDED = (PAGE, WEBTRANSPORT, DASH, WEBRTC, STORE)
"""The ports of the services, which the gateway forwards."""
PORTS = (*FORWARDED, SHAPER)
"""All that a client reaches at the gateway."""
TUN = Path("/dev/net/tun")
"""What the shaper's relay needs."""


def render_command(scenes: Path | None, ladder: str | None = None, https: Port | None = None) -> list[str]:
    """The render service, on all addresses of its namespace."""
    chosen = [
        *(("--scenes", str(scenes)) if scenes else ()),
        *(("--ladder", ladder) if ladder else ()),
        *(("--https", str(https.everywhere)) if https else ()),
    ]
    return tigas("render", "--http", str(PAGE.everywhere), "--quic", str(WEBTRANSPORT.everywhere), *chosen)


def dash_command() -> list[str]:
    """The DASH packager beside the render service, whose views it does not get over the link."""
    return tigas("dash", "--render", f"http://{PAGE.loopback}", "--http", str(DASH.everywhere))


def store_command() -> list[str]:
    """The experiments' store, whose results are in the working directory unless its settings say otherwise."""
    return tigas("store", "--http", str(STORE.everywhere))


def shaper_command(*more: str, https: Port | None = None) -> list[str]:
    """The shaper on the gateway, in front of the services."""
    ports = (*FORWARDED, *((https,) if https else ()))
    forwards = (f"--forward={port.protocol}:{port.number}={SERVICE_ADDRESS}:{port.number}" for port in ports)
    interfaces = ("--access", "access", "--service", "service")
    return tigas("shaper", *interfaces, "--http", str(SHAPER.everywhere), *forwards, *more)


class _DashSettings(ServiceSettings):
    """What the demo must know of the packager's settings."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_DASH_", extra="ignore", frozen=True)
    table: ClassVar[str] = "dash"


class _StoreSettings(ServiceSettings):
    """The same of the store's, for the lab as well."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_STORE_", extra="ignore", frozen=True)
    table: ClassVar[str] = "store"

    results: Path = Path("results")


class _RenderSettings(ServiceSettings):
    """The same of the render service's, for the lab."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_RENDER_", extra="ignore", frozen=True)
    table: ClassVar[str] = "render"

    scenes: Path = MODELS


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

    def shaper(self, *more: str, https: Port | None = None) -> list[str]:
        """A command line that runs the shaper, which alone may change the network of its namespace, and go before other
        processes. Raises StartError.
        """
        argv = self.user.command(shaper_command(*more, https=https), ("net_admin", "sys_nice"))
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


def https_port(address: Address | None) -> Port | None:
    """The port of this machine where the lab's page is over HTTPS. Raises StartError for an address that cannot be."""
    if address is None:
        return None
    if address.host not in ("localhost", "127.0.0.1"):
        raise StartError(
            f"The lab is for this machine alone, so --https {address} is not: to other devices, the shaped link runs "
            "in containers (docs/compose.md)."
        )
    port = Port("tcp", address.port)
    if port in PORTS or not port.number:
        raise StartError(f"--https {address}: the lab has another use for this port; choose 127.0.0.1:8443, say.")
    return port


def run_lab(
    *,
    scenes: Path | None,
    traces: Path | None,
    trace: str | None,
    ladder: str | None,
    https: Address | None,
    stop: threading.Event,
) -> None:
    """Run the whole lab until `stop` is set. Raises StartError if it cannot start, or if a service ends too often."""
    secure = https_port(https)
    check_rights()
    results = load_settings(_StoreSettings, {}).results
    models = scenes or load_settings(_RenderSettings, {}).scenes
    lent = (results, *((models,) if models == MODELS else ()))  # a directory that was named stays whose it is
    caller, user = User.caller(os.environ), User.of_services(os.environ, Path.cwd())
    options = [*(("--traces", str(traces)) if traces else ()), *(("--trace", trace) if trace else ())]
    page = {
        SERVICES_VARIABLE: page_services(shaped=True),
        UPSTREAMS_VARIABLE: upstreams(shaper_host=GATEWAY_SERVICE_ADDRESS),
    }
    render = render_command(models, ladder, secure)
    with Lab(NAME).up((*PORTS, *((secure,) if secure else ())), host=True) as lab:
        for folder in lent:
            user.give(folder)
        needed = [each for each in (models, traces, results) if each is not None and each.is_dir()]
        runner = Runner(lab, user, needed, {VARIABLE: this_commit() or ""})  # git does not tell everybody
        try:
            keep_running(
                (
                    Service("shaper", lambda: runner.start(runner.shaper(*options, https=secure))),
                    Service("render service", lambda: runner.start(runner.service(render), page)),
                    Service("DASH packager", lambda: runner.start(runner.service(dash_command()))),
                    Service("experiment store", lambda: runner.start(runner.service(store_command()))),
                ),
                stop,
            )
        finally:
            for folder in lent:
                caller.give(folder)


def run_demo(render_options: Sequence[str], stop: threading.Event) -> None:
    """Run the services on this machine, without a link between them and the page, until `stop` is set.

    Raises StartError as `run_lab` does.
    """

    environment = {SERVICES_VARIABLE: page_services(shaped=False), UPSTREAMS_VARIABLE: upstreams()} | os.environ
    dash, store = tigas("dash", *_own_names(_DashSettings)), tigas("store", *_own_names(_StoreSettings))
    if "--lan" in render_options:
        dash += ("--http", str(DASH.everywhere))  # nobody hands on what comes over WebRTC

    def start(argv: Sequence[str]) -> subprocess.Popen[bytes]:
        return subprocess.Popen(argv, start_new_session=True, env=environment)

    keep_running(
        (
            Service("DASH packager", lambda: start(dash)),
            Service("experiment store", lambda: start(store)),
            Service("render service", lambda: start(tigas("render", *render_options))),
        ),
        stop,
    )


def _own_names(settings: type[ServiceSettings]) -> list[str]:
    """Options with which a service answers under this machine's names, too, by which other devices know it."""
    own = socket.gethostname().lower()
    hosts = (*load_settings(settings, {}).allow_hosts, *((own, f"{own}.local") if host_of(own) == own else ()))
    return [f"--allow-host={host}" for host in hosts]
