"""Interface to Ray: its machines, detached actors as hosts on them, and the lease of the process that manages them."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import ray
import ray.exceptions
import ray.util
from ray.autoscaler.sdk import request_resources
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from tigas_cluster.connection import NAMESPACE, AlreadyManaged
from tigas_cluster.host import Facts, Host
from tigas_cluster.ray_fleet import Cluster, Node
from tigas_common.errors import StartError

GPU = "GPU"
ACTOR = re.compile(r"(?P<host>host-[0-9]+) (?P<node>[0-9a-f]+)")
"""An actor's name: the host's, followed by its machine, so that finding the actor is enough."""
ANSWER_S = 2.0
"""Timeout for an actor's answer, in seconds."""
START_S = 60.0
"""Timeout for the start of an actor's process, in seconds."""
STOP_S = 3.5
"""Timeout for hosts to end, in seconds."""
LEASE = "director"
LEASE_TIMEOUT_S, LEASE_RETRY_S = 3.0, 0.2
"""Time in which Ray notices that an earlier holder was killed, and interval of attempts until then, in seconds."""


class RayCluster(Cluster):
    """The cluster to which this process is connected."""

    def __init__(self, resource: str, *arguments: Any) -> None:
        """resource: the Ray resource of possible hosts, all of which a host takes. arguments: for `Host`."""
        self._resource = resource
        self._arguments = arguments

    def nodes(self) -> Sequence[Node]:
        alive = ((each, each["Resources"]) for each in ray.nodes() if each["Alive"])
        nodes = (
            Node(each["NodeID"], each["NodeManagerAddress"], has.get(self._resource, 0), has.get(GPU, 0))
            for each, has in alive
        )
        return sorted(nodes, key=lambda node: node.id)

    def hosts(self) -> Mapping[str, str]:
        found = map(ACTOR.fullmatch, ray.util.list_named_actors())
        return {each["host"]: each["node"] for each in found if each}

    def start(self, name: str, node: Node) -> None:
        """Make a machine a host. The host outlives this process, and Ray restarts it. Raises StartError."""
        own = {} if self._resource == GPU else {self._resource: node.amount}
        try:
            actor = _create_actor(
                Host, f"{name} {node.id}", node.id, *self._arguments,
                lifetime="detached", num_gpus=node.gpus, resources=own,
            )  # fmt: skip
            ray.get(actor.facts.remote(), timeout=START_S)
        except ray.exceptions.GetTimeoutError:
            raise StartError(
                f"The host on {node.address} did not start within {START_S:g} s; others may use its resources."
            ) from None
        except (ray.exceptions.RayError, ValueError) as error:  # ValueError: the name is taken
            reason = str(getattr(error, "cause", None) or error).strip().splitlines()[-1]
            raise StartError(f"No host could be started on {node.address}: {reason}") from None

    def facts(self, hosts: Mapping[str, str]) -> Mapping[str, Facts]:
        asked = {}
        for name, actor in self._actors(hosts.items()):
            asked[actor.facts.remote()] = name
        answered, _ = ray.wait(list(asked), num_returns=len(asked), timeout=ANSWER_S) if asked else ([], [])
        facts: dict[str, Facts] = {}
        for answer in answered:
            with suppress(ray.exceptions.RayError):
                facts[asked[answer]] = ray.get(answer)
        return facts

    def stop(self, hosts: Mapping[str, str]) -> None:
        actors = [actor for _, actor in self._actors(hosts.items())]
        if actors:
            ray.wait([actor.stop.remote() for actor in actors], num_returns=len(actors), timeout=STOP_S)
        for actor in actors:
            ray.kill(actor)

    def request_hosts(self, number: int) -> None:
        amount = max((node.amount for node in self.nodes()), default=0) or 1
        request_resources(bundles=[{self._resource: amount}] * number)

    def _actors(self, hosts: Iterable[tuple[str, str]]) -> Iterator[tuple[str, Any]]:
        for name, node in hosts:
            with suppress(ValueError):  # it has ended meanwhile
                yield name, ray.get_actor(f"{name} {node}", namespace=NAMESPACE)


class LeaseHolder:
    """An idle actor. Ray allows each name only once, and ends the actor with its owning process."""


@contextmanager
def hold_lease() -> Iterator[None]:
    """Hold the only right to manage hosts: two processes would undo each other's work. Raises AlreadyManaged."""
    deadline = time.monotonic() + LEASE_TIMEOUT_S
    here = ray.get_runtime_context().get_node_id()
    while True:
        try:
            holder = _create_actor(LeaseHolder, LEASE, here)  # possibly before its process has started
            break
        except ValueError:  # the name is taken
            if time.monotonic() > deadline:
                raise AlreadyManaged from None
            time.sleep(LEASE_RETRY_S)
    try:
        yield
    finally:
        ray.kill(holder)


def _create_actor(kind: type, name: str, node: str, *arguments: Any, **options: Any) -> Any:
    """Create an actor on a machine, restarted if it dies. Raises ValueError if the name is taken."""
    here = NodeAffinitySchedulingStrategy(node, soft=False)
    fixed = {"namespace": NAMESPACE, "num_cpus": 0, "max_restarts": -1, "scheduling_strategy": here}
    return ray.remote(kind).options(name=name, **fixed, **options).remote(*arguments)
