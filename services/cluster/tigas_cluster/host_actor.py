"""A host as an actor of Ray: Ray starts it on a node with all of the node's GPUs, and again if its process dies."""

from __future__ import annotations

from collections.abc import Sequence

import ray.util

from tigas_cluster.host import Facts, Host


class HostActor:
    """Other processes call these methods through Ray."""

    def __init__(self, address: str | None, http_port: int, quic_port: int, options: Sequence[str]) -> None:
        """As of `Host`; address: None for the one by which Ray knows its machine."""
        self._host = Host(address or ray.util.get_node_ip_address(), http_port, quic_port, options)

    def facts(self) -> Facts:
        """As of `Host`."""
        return self._host.facts

    def stop(self) -> None:
        """End the render service, and wait until it has ended."""
        self._host.stop()
