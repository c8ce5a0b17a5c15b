"""What goes wrong between a client and a render service, each in one sentence."""

from __future__ import annotations

from tigas_common.wire.render import Problem


class ClientError(Exception):
    """Why there is no answer that could be used."""


class Unreachable(ClientError):
    """No render service answers there."""


class Refused(ClientError):
    """The service answered that it cannot do it, for the reason that it gives."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.detail)
        self.type = problem.type
        """Stable, such as `tigas:unknown-scene`."""
        self.status = problem.status
        """The HTTP status."""
