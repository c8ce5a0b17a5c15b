"""Documentation of an endpoint beyond its types, for the service's API description."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from pydantic import BaseModel

JSON = "application/json"
TEXT = "text/plain"
BYTES = "application/octet-stream"
PICTURES = ("image/jpeg", "image/png", "image/webp")
HAS_IT_ALREADY = {304: "The client has it already, as its `If-None-Match` says."}

Endpoint = TypeVar("Endpoint", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True)
class Description:
    """Documentation of an endpoint."""

    query: Mapping[str, str] = field(default_factory=dict)
    """Its parameters, all optional, with their meanings."""
    takes: type[BaseModel] | tuple[str, ...] = ()
    """Its body, where it reads that itself: a message, or something of one of these media types."""
    gives: type[BaseModel] | tuple[str, ...] = ()
    """The same of its answer, where that is no ModelResponse."""
    also: Mapping[int, str] = field(default_factory=dict)
    """Additional statuses, with their meanings."""


def described(
    *,
    query: Mapping[str, str] | None = None,
    takes: type[BaseModel] | tuple[str, ...] = (),
    gives: type[BaseModel] | tuple[str, ...] = (),
    also: Mapping[int, str] | None = None,
) -> Callable[[Endpoint], Endpoint]:
    """Gives an endpoint a Description."""

    def describing(endpoint: Endpoint) -> Endpoint:
        endpoint.described = Description(query or {}, takes, gives, also or {})  # type: ignore[attr-defined]
        return endpoint

    return describing


def description(endpoint: Callable[..., Any]) -> Description:
    """Its documentation; empty by default."""
    said: Description = getattr(endpoint, "described", None) or Description()
    return said
