"""Errors of the packager."""

from __future__ import annotations

from tigas_common.errors import TigasError


class UnknownSession(TigasError):
    status, type, title = 404, "unknown-session", "There is no such session"


class TooManySessions(TigasError):
    status, type, title = 503, "too-many-sessions", "The packager has no room for another session"


class UnknownSegment(TigasError):
    status, type, title = 404, "unknown-segment", "There is no such segment"


class ExpiredSegment(TigasError):
    status, type, title = 410, "expired-segment", "The segment has expired"


class EncoderUnavailable(TigasError):
    status, type, title = 503, "encoder-unavailable", "The stream cannot be encoded"


class WebRtcUnavailable(TigasError):
    status, type, title = 503, "webrtc-unavailable", "WebRTC cannot reach this viewer"
