"""This process' connection to a Ray cluster: the one in RAY_ADDRESS, or a private one on this machine.

Nothing here imports ray before its environment is set.
"""

from __future__ import annotations

import importlib.util
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from tigas_cluster.own_ray import OwnRay
from tigas_common.address import Address, host_of
from tigas_common.errors import StartError
from tigas_common.installation import install_command

ADDRESS = "RAY_ADDRESS"
AUTO = "auto"
"""Its value for the cluster that runs on this machine."""
REACH_S = 5.0
"""For the head to be reached, in seconds."""
NAMESPACE = "tigas"
"""Ray namespace of our actors."""


def check_ray() -> None:
    """Raises StartError where Ray is not installed."""
    if importlib.util.find_spec("ray") is None:
        raise StartError(f"A cluster needs Ray, which is not installed: {install_command('cluster')}")


def named_cluster() -> str | None:
    """The address of the cluster to join, if one is configured. Raises StartError."""
    address = os.environ.get(ADDRESS)
    if not address or address == AUTO:
        return address or None
    if host_of(address) is None or ":" not in address:
        raise StartError(f"{ADDRESS} must be the head's HOST:PORT, such as 10.0.0.1:6379, not {address[:100]!r}.")
    head = Address.parse(address)
    try:
        socket.create_connection((head.host, head.port), REACH_S).close()  # Ray would try for minutes
    except OSError as error:
        raise StartError(f"The Ray cluster at {head} cannot be reached ({error.strerror or error}).") from None
    return address


@contextmanager
def connected(own: OwnRay | None, address: str) -> Iterator[None]:
    """Connect to this cluster as a driver, as a context manager; own: the private one, if it is that. Raises
    StartError.
    """
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    if own is not None:
        os.environ.update(own.environment)
    import ray

    try:
        ray.init(
            address=address,
            namespace=NAMESPACE,
            log_to_driver=False,
            configure_logging=False,
            include_dashboard=False,
        )
    except (ConnectionError, RuntimeError, TimeoutError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise StartError(f"The Ray cluster at {address} cannot be joined: {reason}") from None
    ray._private.worker._worker_logs_enabled = False  # we report the state of hosts in fewer words
    try:
        yield
    finally:
        ray.shutdown()
