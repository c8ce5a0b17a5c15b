"""That one `tigas cluster up` at a time looks after a Ray cluster: two would start and end each other's hosts."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import ray
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from tigas_cluster.connection import NAMESPACE
from tigas_cluster.errors import AnotherUp

NAME = "director"
FREED_S, AGAIN_S = 3.0, 0.2
"""Within which Ray notices that an earlier one was killed, and how often it is tried until then, in seconds."""


class Holder:
    """An idle actor. Ray allows a name only once, and ends the actor with its owning process."""


@contextmanager
def held(clock: Callable[[], float] = time.monotonic) -> Iterator[None]:
    """Hold the lease, as a context manager. Raises AnotherUp."""
    deadline = clock() + FREED_S
    while (actor := _taken()) is None:
        if clock() > deadline:
            raise AnotherUp
        time.sleep(AGAIN_S)
    try:
        yield
    finally:
        ray.kill(actor)


def _taken() -> Any:
    """The actor, possibly before its process has started; None if the name is taken."""
    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
    options = {"name": NAME, "namespace": NAMESPACE, "num_cpus": 0, "scheduling_strategy": here, "max_restarts": -1}
    try:
        return ray.remote(Holder).options(**options).remote()
    except ValueError:
        return None
