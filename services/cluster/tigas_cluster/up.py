"""`tigas cluster up`: joins or starts Ray, manages the hosts, and serves the director."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, NoReturn

from tigas_cluster.connection import RESOURCE, AlreadyManaged, PrivateRay, configured_address, connect
from tigas_cluster.director import create_director
from tigas_cluster.fleet import Fleet
from tigas_cluster.policy import Scaler
from tigas_cluster.ray_fleet import RayFleet
from tigas_cluster.settings import ClusterSettings
from tigas_common.address import bracket_host, warn_if_open
from tigas_common.limits import HttpLimits
from tigas_common.loop_share import LoopShare
from tigas_common.origins import OriginPolicy
from tigas_common.processes import interrupt_on_sigterm
from tigas_common.runner import listen_errors, serve_listener, wait_for_stop
from tigas_common.terminal import printable

if TYPE_CHECKING:
    from tigas_cluster.ray_cluster import RayCluster

LOOPBACK = "127.0.0.1"
STOP_TIMEOUT_S = 4.5
"""Timeout for all hosts to end, in seconds."""


def up(settings: ClusterSettings, render_options: Sequence[str]) -> None:
    """Run the cluster until SIGINT or SIGTERM. Raises StartError."""
    address = configured_address()
    with listen_errors(settings.http, "--http"):
        listener = settings.http.listen(HttpLimits.from_settings(settings.http_limits).unread_s)
    with listener, interrupt_on_sigterm():
        if address is not None:
            _run(settings, render_options, listener, address, None, ExitStack())
            return
        own = PrivateRay()
        with ExitStack() as after:
            if own.find_address() is None:
                after.callback(own.stop)
            print("Starting Ray on this machine …", flush=True)
            try:
                _run(settings, render_options, listener, own.start(), own, after)
            except AlreadyManaged:
                after.pop_all()  # that process needs this Ray
                raise


def _run(
    settings: ClusterSettings,
    render_options: Sequence[str],
    listener: socket.socket,
    address: str,
    own: PrivateRay | None,
    after: ExitStack,
) -> None:
    """Serve until stopped, on the Ray at this address. `after` ends a private Ray, unless another process uses it."""
    with connect(own, address):
        import ray.util

        from tigas_cluster.ray_cluster import GPU, RayCluster, hold_lease

        names = (ray.util.get_node_ip_address(), *settings.allow_hosts)
        pages = (*settings.allow_origins, *_page_origins(settings, listener.getsockname()[1], names))
        scenes = ("--scenes", str(settings.scenes.absolute())) if settings.scenes else ()
        options = [*scenes, *(f"--allow-origin={page}" for page in pages), *render_options]
        hosts_address = LOOPBACK if own and settings.http.is_loopback else None
        cluster = RayCluster(
            RESOURCE if own else settings.resource or GPU,
            hosts_address,
            settings.host_http_port,
            settings.host_quic_port,
            options,
        )
        with hold_lease():
            if own is not None:
                after.callback(own.stop)
            asyncio.run(_serve(settings, cluster, listener, own))


async def _serve(
    settings: ClusterSettings, cluster: RayCluster, listener: socket.socket, own: PrivateRay | None
) -> None:
    stopped = asyncio.create_task(wait_for_stop())
    scaler = Scaler(settings.hosts, 60 * settings.calm_minutes, 60 * settings.grace_minutes, time.monotonic)
    origins = OriginPolicy.from_addresses([settings.http], settings.allow_hosts, settings.allow_origins)
    async with (
        Fleet((), time.monotonic) as fleet,
        RayFleet(cluster, scaler, fleet, time.monotonic, _say) as hosts,
    ):
        try:
            async with (
                create_director(fleet, origins=origins, clock=time.monotonic, services=settings.services) as app,
                serve_listener(
                    LoopShare(app, settings.http_limits.loop_share_per_address, origins),
                    listener,
                    HttpLimits.from_settings(settings.http_limits),
                ) as port,
            ):
                await asyncio.wait((stopped, hosts.ready), return_when=asyncio.FIRST_COMPLETED)
                if hosts.ready.done():
                    hosts.ready.result()
                    warn_if_open([settings.http])
                    _say(f"Open http://{settings.http.reachable_host}:{port}/")
                await stopped
        finally:
            stopped.cancel()
            try:
                async with asyncio.timeout(STOP_TIMEOUT_S):
                    await hosts.stop()
            except TimeoutError:
                _abandon(own)


def _abandon(own: PrivateRay | None) -> NoReturn:
    """Exit without Ray, as its calls block for a minute once the head is down, and cannot be interrupted."""
    print("Ray does not answer; remaining hosts end with Ray on their machines.", file=sys.stderr, flush=True)
    if own is not None:
        own.stop()
    os._exit(1)


def _say(text: str) -> None:
    print(printable(text, lines=True), flush=True)


def _page_origins(settings: ClusterSettings, port: int, names: Sequence[str]) -> Iterator[str]:
    """The page's origins, which differ from the hosts' origins."""
    at_port = "" if port == 80 else f":{port}"
    own = () if settings.http.is_loopback else (settings.http.reachable_host, socket.gethostname(), *names)
    for name in dict.fromkeys(("localhost", LOOPBACK, *own)):
        yield f"http://{bracket_host(name)}{at_port}"
    for name in settings.allow_hosts:  # a proxy in front of the director may speak TLS
        yield f"https://{name}"
