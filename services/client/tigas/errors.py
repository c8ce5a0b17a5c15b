"""Errors in communication between a client and a render service, with one sentence each."""

from __future__ import annotations

from tigas_common.wire.render import Problem


class ClientError(Exception):
    """Base class of the client's errors."""


class Unreachable(ClientError):
    """No render service answered."""


class Refused(ClientError):
    """The service refused the request."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.detail)
        self.type = problem.type
        """Stable problem type, such as `tigas:unknown-scene`."""
        self.status = problem.status
        """HTTP status."""
