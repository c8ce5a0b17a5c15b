"""Errors of the packager."""

from __future__ import annotations

from tigas_common.errors import TigasError
from tigas_common.wire.render import Problem


class UnknownSession(TigasError):
    """No session has this id: it never existed, was ended, or timed out."""

    status, type, title = 404, "unknown-session", "There is no such session"


class TooManySessions(TigasError):
    """The packager encodes as many streams as it may."""

    status, type, title = 503, "too-many-sessions", "The packager has no room for another session"


class UnknownSegment(TigasError):
    """A session has no such representation or segment, or will have it too far in the future."""

    status, type, title = 404, "unknown-segment", "There is no such segment"


class ExpiredSegment(TigasError):
    """The segment has left the time-shift window."""

    status, type, title = 410, "expired-segment", "The segment is kept no longer"


class EncoderUnavailable(TigasError):
    """No encoder supports the request."""

    status, type, title = 503, "encoder-unavailable", "The stream cannot be encoded"


class WebRtcUnavailable(TigasError):
    """WebRTC is not installed, or the packager is on loopback and the viewer is not."""

    status, type, title = 503, "webrtc-unavailable", "The packager has no WebRTC"


class RenderUnavailable(TigasError):
    """The render service gives no frames."""

    status, type, title = 502, "render-unavailable", "The render service gives no frames"


class RenderProblem(TigasError):
    """The render service refused; its own problem is passed on."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.detail)
        self.status = problem.status
        self.type = problem.type.removeprefix("tigas:")
        self.title = problem.title
