"""Interface to Ray: its machines, detached actors as hosts on them, and the lease of the process that keeps them."""

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

from tigas_cluster.connection import NAMESPACE, AnotherUp
from tigas_cluster.host import Facts, Host
from tigas_cluster.ray_fleet import Cluster, Node
from tigas_common.errors import StartError

GPU = "GPU"
ACTOR = re.compile(r"(?P<host>host-[0-9]+) (?P<node>[0-9a-f]+)")
"""Prefix of an actor's name, followed by its machine, so that finding it is enough."""
ANSWER_S = 2.0
"""For an actor to answer, in seconds."""
START_S = 60.0
"""For an actor's process to start, in seconds."""
STOP_S = 3.5
"""For hosts to end, in seconds."""
LEASE = "director"
FREED_S, AGAIN_S = 3.0, 0.2
"""Within which Ray notices that an earlier holder was killed, and how often it is tried until then, in seconds."""


class RayCluster(Cluster):
    """The cluster that this process is connected to."""

    def __init__(self, resource: str, *arguments: Any) -> None:
        """resource: the Ray resource of machines that may be hosts; each host takes all of it. arguments: of `Host`."""
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
        """Make a machine a host, which stays one if this process ends; Ray restarts it. Raises StartError."""
        own = {} if self._resource == GPU else {self._resource: node.amount}
        try:
            actor = _actor(
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

    def ask_for(self, number: int) -> None:
        amount = max((node.amount for node in self.nodes()), default=0) or 1
        request_resources(bundles=[{self._resource: amount}] * number)

    def _actors(self, hosts: Iterable[tuple[str, str]]) -> Iterator[tuple[str, Any]]:
        for name, node in hosts:
            with suppress(ValueError):  # it has ended meanwhile
                yield name, ray.get_actor(f"{name} {node}", namespace=NAMESPACE)


class Holder:
    """An idle actor. Ray allows a name only once, and ends the actor with its owning process."""


@contextmanager
def leased() -> Iterator[None]:
    """Keep hosts alone, as a context manager: two would start and end each other's. Raises AnotherUp."""
    deadline = time.monotonic() + FREED_S
    here = ray.get_runtime_context().get_node_id()
    while True:
        try:
            holder = _actor(Holder, LEASE, here)  # possibly before its process has started
            break
        except ValueError:  # the name is taken
            if time.monotonic() > deadline:
                raise AnotherUp from None
            time.sleep(AGAIN_S)
    try:
        yield
    finally:
        ray.kill(holder)


def _actor(kind: type, name: str, node: str, *arguments: Any, **options: Any) -> Any:
    """A new actor on a machine, started again if it dies. Raises ValueError if there is one of this name."""
    here = NodeAffinitySchedulingStrategy(node, soft=False)
    fixed = {"namespace": NAMESPACE, "num_cpus": 0, "max_restarts": -1, "scheduling_strategy": here}
    return ray.remote(kind).options(name=name, **fixed, **options).remote(*arguments)
