"""Wires the shaper together: settings, link and API."""

from __future__ import annotations

import asyncio
import ipaddress
import json
import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from contextlib import AsyncExitStack, suppress

from tigas_common.address import Address, warn_if_open
from tigas_common.errors import StartError, TigasError
from tigas_common.limits import HttpLimits
from tigas_common.loop_share import LoopShare
from tigas_common.origins import OriginPolicy
from tigas_common.resources import CAP_NET_ADMIN, has_capabilities, use_one_arena
from tigas_common.runner import listen_errors, serve_http, wait_for_stop
from tigas_shaper.api import create_app
from tigas_shaper.link.commands import Interface
from tigas_shaper.link.gateway import Forward
from tigas_shaper.link.link import MAX_MTU
from tigas_shaper.service import Shaper
from tigas_shaper.settings import ShaperSettings


async def serve(settings: ShaperSettings) -> None:
    """Run the shaper until SIGINT or SIGTERM. Raises StartError."""
    use_one_arena()
    access, service = find_interface(settings.access), find_interface(settings.service)
    if access == service:
        raise StartError(f"The clients and the services must be on different interfaces, but both are on {access}.")
    if settings.traces is not None and not settings.traces.is_dir():
        raise StartError(f"The directory {settings.traces} does not exist; choose another with --traces.")
    try:
        forwards = [Forward.parse(text) for text in settings.forward]
    except ValueError as error:
        raise StartError(f"{error}.") from None
    check_ports(forwards, settings.http)
    check_mtu(access, service)
    # By default, Python's threads take turns every 5 ms: reading a trace in a thread would make the player as late.
    sys.setswitchinterval(0.0005)
    with suppress(OSError):
        os.nice(-10)  # a link does not slow down because its machine is busy
    async with AsyncExitStack() as stack:
        shaper = await stack.enter_async_context(Shaper.open(settings, access, service, forwards))
        if settings.trace is not None:
            try:
                shaper.player.start(await asyncio.to_thread(shaper.library.get, settings.trace))
            except TigasError as error:
                raise StartError(error.detail) from None
        with listen_errors(settings.http, "--http"):
            policy = OriginPolicy.from_addresses(
                [settings.http], settings.allow_hosts, settings.allow_origins, programs=False
            )
            app = LoopShare(create_app(shaper, policy), settings.http_limits.loop_share_per_address, policy)
            port = await stack.enter_async_context(
                serve_http(app, settings.http, HttpLimits.from_settings(settings.http_limits))
            )
        shown = ", ".join(settings.forward)
        print(f"Shaping {access} ↔ {service} ({shaper.status().backend}), forwarding {shown}.")
        warn_if_open([settings.http])
        print(f"API on http://{settings.http.reachable_host}:{port}/", flush=True)
        await wait_for_stop()
        shaper.stop_watching()


def check_ports(forwards: Sequence[Forward], api: Address) -> None:
    """Raise StartError if clients could not reach a forward because another one, or the API, uses its port."""
    ports = [(forward.protocol, forward.port) for forward in forwards]
    twice = next((port for port in ports if ports.count(port) > 1), None)
    if twice is not None:
        raise StartError(f"Port {twice[1]} ({twice[0]}) is forwarded twice.")
    if ("tcp", api.port) in ports and not api.is_loopback:
        raise StartError(f"Port {api.port} cannot be forwarded, because the shaper's API uses it.")


def check_mtu(*interfaces: Interface) -> None:
    """Raise StartError if an interface may send longer packets than the link accepts."""
    for interface in interfaces:
        if interface.mtu > MAX_MTU:
            raise StartError(
                f"The link takes packets of up to {MAX_MTU} bytes, and {interface} has an MTU of {interface.mtu}: "
                f"ip link set {interface} mtu {MAX_MTU}"
            )


def check_rights() -> None:
    """Raise StartError if this process cannot shape a network."""
    if platform.system() != "Linux":
        raise StartError("The shaper needs Linux; on other systems, run it in its container.")
    if not has_capabilities(CAP_NET_ADMIN):
        raise StartError(
            "The shaper needs permission to configure the network (CAP_NET_ADMIN): "
            "run it as root, or in a container with cap_add: NET_ADMIN."
        )


def find_interface(text: str) -> Interface:
    """Find an interface by name, or by an IPv4 network in which it has an address. Raises StartError."""
    try:
        network = ipaddress.IPv4Network(text, strict=False)
    except ValueError:
        try:
            interface = Interface(text)
        except ValueError as error:
            raise StartError(f"{error}.") from None
        if interface.number is None:
            raise StartError(f"There is no network interface {text}.") from None
        return interface
    try:
        answer = subprocess.run(("ip", "-j", "-4", "address", "show"), check=True, capture_output=True)
    except FileNotFoundError:
        raise StartError("The shaper needs ip: install iproute2 and nftables.") from None
    except subprocess.CalledProcessError as error:
        raise StartError(
            f"The network interfaces are unknown: {error.stderr.decode(errors='replace').strip()}"
        ) from None
    for entry in json.loads(answer.stdout):
        if any(ipaddress.IPv4Address(address["local"]) in network for address in entry.get("addr_info", ())):
            return Interface(entry["ifname"])
    raise StartError(f"No network interface has an address in {network}.")
