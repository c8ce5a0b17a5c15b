"""Typed errors, raised deep in the code and mapped to HTTP answers in one place: `problem` (RFC 9457)."""

from __future__ import annotations

from tigas_common.wire.render import Problem


class TigasError(Exception):
    """An error with one sentence that a person can act on. Subclasses define the HTTP status and a stable type."""

    status = 500
    type = "internal-error"
    title = "The server failed"

    def __init__(self, detail: str, retry_after_s: float | None = None) -> None:
        super().__init__(detail)
        self.detail = detail
        self.retry_after_s = retry_after_s
        """When to try again, in seconds, if known."""


class InvalidRequest(TigasError):
    status, type, title = 400, "invalid-request", "The request is not valid"


class RequestTimeout(TigasError):
    status, type, title = 408, "request-timeout", "The request arrived too slowly"


class TooManyConnections(TigasError):
    status, type, title = 503, "too-many-connections", "There are too many connections"


class BodyTooLarge(TigasError):
    status, type, title = 413, "body-too-large", "The request is too large"


class TooCostly(TigasError):
    status, type, title = 422, "too-costly", "Checking the request takes too much"


class DiskFull(TigasError):
    status, type, title = 507, "disk-full", "The disk is full"


class StorageFailed(TigasError):
    status, type, title = 500, "storage-failed", "The disk failed"


class UnknownScene(TigasError):
    status, type, title = 404, "unknown-scene", "There is no such scene"


class BrokenScene(TigasError):
    status, type, title = 422, "broken-scene", "The scene cannot be loaded"


class SceneInUse(TigasError):
    status, type, title = 409, "scene-in-use", "The scene is in use"


class Superseded(TigasError):
    status, type, title = 409, "superseded", "The request was superseded"


class DeadlineExceeded(TigasError):
    status, type, title = 504, "deadline-exceeded", "The frame would be too late"


class Overloaded(TigasError):
    status, type, title = 503, "overloaded", "The server is overloaded"


class NoRoom(Overloaded):
    """Scenes in use leave no room for another one on the device."""


class ServerFull(Overloaded):
    status, type, title = 503, "full", "The server is full"


class AskedTooOften(TigasError):
    status, type, title = 429, "asked-too-often", "Too many requests"


class UnknownService(TigasError):
    status, type, title = 404, "unknown-service", "There is no such service"


class ServiceAway(TigasError):
    status, type, title = 502, "service-away", "Another service is unreachable"


class ServiceSilent(TigasError):
    status, type, title = 504, "service-silent", "Another service did not answer in time"


class OutOfDeviceMemory(TigasError):
    status, type, title = 503, "out-of-memory", "The GPU's memory is full"


class DeviceLost(TigasError):
    status, type, title = 503, "device-lost", "The GPU failed"


class StartError(Exception):
    """Reason why a service cannot start, in one sentence for its operator."""


class UsageError(Exception):
    """An invalid command line or settings file, described in one sentence."""


def problem(error: Exception) -> Problem:
    """The answer to a failed request. Any error but a TigasError becomes a 500 without internal details."""
    known = error if isinstance(error, TigasError) else TigasError("The server failed; its log says why.")
    return Problem(type=f"tigas:{known.type}", title=known.title, status=known.status, detail=known.detail)
