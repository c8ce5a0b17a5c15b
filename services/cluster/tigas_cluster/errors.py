"""Start errors of a cluster that callers must distinguish."""

from __future__ import annotations

from tigas_common.errors import StartError


class AnotherUp(StartError):
    """The running or starting Ray belongs to another `tigas cluster up`."""

    def __init__(self) -> None:
        super().__init__("Another `tigas cluster up` looks after this cluster; end that one first.")
