"""Typed errors, raised deep and mapped to an answer in one place: `problem` (RFC 9457)."""

from __future__ import annotations

from tigas_common.wire.render import Problem


class TigasError(Exception):
    """An error with one sentence that a person can act on. Subclasses fix the HTTP status and the stable type."""

    status = 500
    type = "internal-error"
    title = "The server failed"

    def __init__(self, detail: str, retry_after_s: float | None = None) -> None:
        super().__init__(detail)
        self.detail = detail
        self.retry_after_s = retry_after_s
        """When to try again, in seconds, if that is known."""


class InvalidRequest(TigasError):
    """The request cannot be understood or asks for something out of range."""

    status, type, title = 400, "invalid-request", "The request is not valid"


class RequestTimeout(TigasError):
    """The request did not arrive whole in time."""

    status, type, title = 408, "request-timeout", "The request came too slowly"


class TooManyConnections(TigasError):
    """The client's address, or all clients together, have as many connections as they may."""

    status, type, title = 503, "too-many-connections", "There are too many connections"


class BodyTooLarge(TigasError):
    """The request's body is over the limit."""

    status, type, title = 413, "body-too-large", "The request is too large"


class TooCostly(TigasError):
    """Validating the input took more memory or time than any sensible input of its size."""

    status, type, title = 422, "too-costly", "It takes too much to check"


class DiskFull(TigasError):
    """Nothing more can be kept."""

    status, type, title = 507, "disk-full", "The disk is full"


class StorageFailed(TigasError):
    """The system denies reading or writing stored data."""

    status, type, title = 500, "storage-failed", "The disk failed"


class UnknownScene(TigasError):
    """No scene has this id."""

    status, type, title = 404, "unknown-scene", "There is no such scene"


class BrokenScene(TigasError):
    """The scene's file cannot be read, or is larger than the memory that scenes may take."""

    status, type, title = 422, "broken-scene", "The scene cannot be loaded"


class SceneInUse(TigasError):
    """The scene to unload has viewers."""

    status, type, title = 409, "scene-in-use", "The scene is in use"


class Superseded(TigasError):
    """A newer request of the same client took this one's place before it was rendered."""

    status, type, title = 409, "superseded", "A newer request took this one's place"


class DeadlineExceeded(TigasError):
    """The frame could not have been ready by the request's deadline, so it was not rendered."""

    status, type, title = 504, "deadline-exceeded", "The frame would have come too late"


class Overloaded(TigasError):
    """The server, or the client's part of it, has as much to do as it may."""

    status, type, title = 503, "overloaded", "The server has too much to do"


class NoRoom(Overloaded):
    """Scenes that are in use leave no room for another on the device."""


class ServerFull(Overloaded):
    """The server serves its present viewers and admits no others for now."""

    status, type, title = 503, "full", "The server is full"


class AskedTooOften(TigasError):
    """The client asks more often than it may."""

    status, type, title = 429, "asked-too-often", "You ask too often"


class UnknownService(TigasError):
    """Nothing is handed on under this name."""

    status, type, title = 404, "unknown-service", "There is no such service"


class ServiceAway(TigasError):
    """The service that this is handed on to does not answer."""

    status, type, title = 502, "service-away", "Another service is away"


class ServiceSilent(TigasError):
    """The service that this is handed on to takes too long."""

    status, type, title = 504, "service-silent", "Another service does not answer in time"


class OutOfDeviceMemory(TigasError):
    """The rendering device has too little free memory, even after unloading unused scenes."""

    status, type, title = 503, "out-of-memory", "The GPU's memory is full"


class DeviceLost(TigasError):
    """The device that renders failed for good; the service has to be restarted."""

    status, type, title = 503, "device-lost", "The GPU failed"


class StartError(Exception):
    """Reason why a service cannot start, in one sentence for its operator."""


class UsageError(Exception):
    """A wrong command line or settings file, in one sentence."""


def problem(error: Exception) -> Problem:
    """The answer to a failed request. Anything but a TigasError becomes a 500 without internal details."""
    known = error if isinstance(error, TigasError) else TigasError("The server failed; its log says why.")
    return Problem(type=f"tigas:{known.type}", title=known.title, status=known.status, detail=known.detail)
