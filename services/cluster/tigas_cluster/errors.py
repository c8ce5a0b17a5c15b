"""What keeps a cluster from starting and must be told apart from other reasons."""

from __future__ import annotations

from tigas_common.errors import StartError


class AnotherUp(StartError):
    """The Ray that was found, or is about to start, belongs to another `tigas cluster up`."""

    def __init__(self) -> None:
        super().__init__("Another `tigas cluster up` looks after this cluster; end that one first.")
