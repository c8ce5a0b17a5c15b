"""Errors of a link, each with one actionable sentence."""

from __future__ import annotations

from tigas_common.errors import TigasError


class LinkClosed(TigasError):
    """The link could not be shaped, so no packet crosses it until the shaper is restarted."""

    status, type, title = 503, "link-closed", "The link is closed"


class UnknownTrace(TigasError):
    """No trace has this name."""

    status, type, title = 404, "unknown-trace", "There is no such network trace"


class TooManyTraces(TigasError):
    """As many uploaded traces are kept as may be."""

    status, type, title = 409, "too-many-traces", "There are too many uploaded traces"


class NothingPlays(TigasError):
    """There is no trace to pause, resume, seek or loop."""

    status, type, title = 409, "nothing-plays", "No trace is playing"
