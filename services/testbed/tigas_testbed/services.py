"""The services behind the lab's gateway, the shaper on the gateway, and the same services without a lab."""

from __future__ import annotations

import errno
import json
import os
import socket
import subprocess
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from tigas_common.address import ISOLATED_VARIABLE, Address, parse_host
from tigas_common.cli import load_settings
from tigas_common.errors import StartError
from tigas_common.installation import COMMIT_VARIABLE, this_commit
from tigas_common.processes import Service, keep_running, tigas_command
from tigas_common.settings import MODELS
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
    services_json,
    upstreams_json,
)
from tigas_testbed.namespaces import GATEWAY_SERVICE_ADDRESS, SERVICE_ADDRESS, Lab, check_rights
from tigas_testbed.user import User, code_folders, grant_access

NAME = "lab"
FORWARDED = (PAGE, WEBTRANSPORT, DASH, WEBRTC, STORE)
"""Ports of the services, which the gateway forwards."""
PORTS = (*FORWARDED, SHAPER)
"""All ports that a client can reach on the gateway."""
TUN = Path("/dev/net/tun")
"""Device that the shaper's relay requires."""


def render_command(scenes: Path | None, https: Port | None = None) -> list[str]:
    """Command of the render service, on all addresses of its namespace."""
    chosen = [
        *(("--scenes", str(scenes)) if scenes else ()),
        *(("--https", str(https.all_interfaces)) if https else ()),
    ]
    return tigas_command(
        "render", "--http", str(PAGE.all_interfaces), "--quic", str(WEBTRANSPORT.all_interfaces), *chosen
    )


def dash_command() -> list[str]:
    """Command of the packager next to the render service, which it reaches without the shaped link."""
    return tigas_command("dash", "--render", f"http://{PAGE.loopback}", "--http", str(DASH.all_interfaces))


def store_command() -> list[str]:
    """Command of the experiment store, which keeps results in the working directory by default."""
    return tigas_command("store", "--http", str(STORE.all_interfaces))


def shaper_command(*more: str, https: Port | None = None) -> list[str]:
    """Command of the shaper on the gateway, in front of the services."""
    ports = (*FORWARDED, *((https,) if https else ()))
    forwards = (f"--forward={port.protocol}:{port.number}={SERVICE_ADDRESS}:{port.number}" for port in ports)
    interfaces = ("--access", "access", "--service", "service")
    return tigas_command("shaper", *interfaces, "--http", str(SHAPER.all_interfaces), *forwards, *more)


@dataclass(frozen=True, slots=True)
class Runner:
    """Runs services in a lab as an ordinary user."""

    lab: Lab
    user: User
    needed: Sequence[Path] = ()
    """Directories that services must reach, in addition to their code."""
    environment: Mapping[str, str] = field(default_factory=dict)
    """Additions to this process's environment."""

    def service(self, argv: Sequence[str]) -> list[str]:
        """Command line that runs a service. Raises StartError."""
        reached = grant_access(self.user, (*code_folders(), *self.needed), (), self.user.command(argv))
        return self.lab.command("service", reached)

    def shaper(self, *more: str, https: Port | None = None) -> list[str]:
        """Command line that runs the shaper, the only service that may change its namespace's network and raise its
        priority. Raises StartError.
        """
        argv = self.user.command(shaper_command(*more, https=https), ("net_admin", "sys_nice"))
        return self.lab.command("gateway", grant_access(self.user, (*code_folders(), *self.needed), (TUN,), argv))

    def start(
        self, command: Sequence[str], environment: Mapping[str, str] = MappingProxyType({})
    ) -> subprocess.Popen[bytes]:
        """Start such a command line as the leader of a session, with additional environment variables."""
        own = {name: value for name, value in os.environ.items() if not name.startswith("XDG_")}  # root's directories
        return subprocess.Popen(
            command,
            start_new_session=True,
            env={**own, **self.user.environment(), ISOLATED_VARIABLE: "yes", **self.environment, **environment},
        )


def https_port(address: Address | None) -> Port | None:
    """The port on this machine of the lab's page over HTTPS. Raises StartError for an unusable address."""
    if address is None:
        return None
    if address.host not in ("localhost", "127.0.0.1"):
        raise StartError(
            f"The lab serves only this machine, so --https {address} is impossible; for other devices, run the shaped "
            "link in containers (docs/deploy.md)."
        )
    port = Port("tcp", address.port)
    if port in PORTS or not port.number:
        raise StartError(f"--https {address}: the lab needs this port itself; choose another, such as 127.0.0.1:8443.")
    return port


def check_ports_free(ports: Sequence[Port]) -> None:
    """Raise StartError if a program on this machine uses one of the lab's ports.

    For a browser, `localhost` is ::1 if a program listens there, so that address is checked as well if there is IPv6.
    """
    for port in ports:
        kind = socket.SOCK_STREAM if port.protocol == "tcp" else socket.SOCK_DGRAM
        for family, address in ((socket.AF_INET, port.loopback), (socket.AF_INET6, Address("::1", port.number))):
            try:
                with socket.socket(family, kind) as sock:
                    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, int(port.protocol == "tcp"))
                    sock.bind((address.host, address.port))
            except OSError as error:
                if family == socket.AF_INET or error.errno == errno.EADDRINUSE:
                    raise StartError(f"The lab needs {port.protocol} port {address} ({error.strerror}).") from None


def run_lab(*, https: Address | None, store: bool, stop: threading.Event) -> None:
    """Run the whole lab, with or without the experiment store, until `stop` is set.

    Raises StartError if it cannot start, or if a service exits too often.
    """
    secure = https_port(https)
    check_rights()
    ports = (*PORTS, *((secure,) if secure else ()))
    check_ports_free(ports)
    results: Path = load_settings("store").results
    models: Path = load_settings("render").scenes
    required = ("--access=access", "--service=service", "--forward=tcp:1=localhost:1")
    traces: Path | None = load_settings("shaper", required).traces
    owned_folders = (results, *((models,) if models == MODELS else ()))  # an explicitly named directory keeps its owner
    caller, user = User.sudo_caller(os.environ), User.service_user(os.environ, Path.cwd())
    options = ("--traces", str(traces)) if traces else ()
    page = {
        SERVICES_VARIABLE: services_json(shaped=True, store=store),
        UPSTREAMS_VARIABLE: upstreams_json(shaper_host=GATEWAY_SERVICE_ADDRESS, store=store),
    }
    render = render_command(models, secure)
    with Lab(NAME).up(ports, host=True) as lab:
        for folder in owned_folders:
            user.take_ownership(folder)
        needed = [each for each in (models, traces, results) if each is not None and each.is_dir()]
        runner = Runner(lab, user, needed, {COMMIT_VARIABLE: this_commit() or ""})  # git refuses other users
        services = [
            Service("shaper", lambda: runner.start(runner.shaper(*options, https=secure))),
            Service("render service", lambda: runner.start(runner.service(render), page)),
            Service("DASH packager", lambda: runner.start(runner.service(dash_command()))),
        ]
        if store:
            services.append(Service("experiment store", lambda: runner.start(runner.service(store_command()))))
        try:
            keep_running(services, stop)
        finally:
            for folder in owned_folders:
                caller.take_ownership(folder)


def run_demo(render_options: Sequence[str], stop: threading.Event, *, store: bool) -> None:
    """Run the services without a shaped link until `stop` is set. Raises StartError and UsageError."""
    services = services_json(shaped=False, store=store)
    environment = {SERVICES_VARIABLE: services, UPSTREAMS_VARIABLE: upstreams_json(store=store)} | os.environ
    page: Address = load_settings("render", render_options).http
    if page.port not in (0, PAGE.number):
        url = f"http://{page.reachable_host}:{page.port}"
        environment = {"TIGAS_DASH_RENDER": url, "TIGAS_STORE_RENDER": url} | environment
    dash = tigas_command("dash")
    if "--lan" in render_options:
        dash += ("--http", str(DASH.all_interfaces))  # nothing forwards WebRTC traffic

    def start(argv: Sequence[str], more: Mapping[str, str] = MappingProxyType({})) -> subprocess.Popen[bytes]:
        return subprocess.Popen(argv, start_new_session=True, env={**environment, **more})

    running = [
        Service("DASH packager", lambda: start(dash, _host_names_env("dash"))),
        Service("render service", lambda: start(tigas_command("render", *render_options))),
    ]
    if store:
        running.insert(0, Service("experiment store", lambda: start(tigas_command("store"), _host_names_env("store"))))
    keep_running(running, stop)


def _host_names_env(service: str) -> dict[str, str]:
    """Environment in which a service also answers to this machine's names on the network."""
    own = socket.gethostname().lower()
    hosts = (*load_settings(service).allow_hosts, *((own, f"{own}.local") if parse_host(own) == own else ()))
    return {f"TIGAS_{service.upper()}_ALLOW_HOSTS": json.dumps(hosts)}
