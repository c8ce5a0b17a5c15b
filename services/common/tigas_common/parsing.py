"""Parsing of bytes into wire models, with one sentence for any error."""

from __future__ import annotations

from functools import cache
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from tigas_common.errors import BodyTooLarge, InvalidRequest

MAX_BODY = 16 * 1024
"""Maximum size of a request body in bytes, unless a service accepts more."""

MAX_ERRORS = 1000
"""Beyond this number, pydantic's report takes a hundred times as much memory as the text with the errors."""

Message = TypeVar("Message")


def parse(kind: type[Message], body: bytes, limit: int = MAX_BODY) -> Message:
    """Parse a message, a wire model or dataclass, from JSON.

    Raises BodyTooLarge over `limit` bytes, and InvalidRequest naming the first invalid field.
    """
    if len(body) > limit:
        raise BodyTooLarge(f"The body has {len(body)} bytes; the limit is {limit}.")
    try:
        message: Message = _adapter(kind).validate_json(body)  # type: ignore[arg-type]
    except ValidationError as error:
        raise InvalidRequest(describe_error(error)) from None
    return message


def describe_error(error: ValidationError) -> str:
    """Describe the first error and its field; of very many, only their number."""
    if error.error_count() > MAX_ERRORS:
        return f"There are {error.error_count():,} errors."
    first = error.errors(include_url=False, include_input=False, include_context=False)[0]
    where = ".".join(quotable(str(part), 60) for part in first["loc"])
    what = quotable(first["msg"].removeprefix("Value error, "), 250)
    what = what[:1].lower() + what[1:] if where else what[:1].upper() + what[1:]
    return f"{where}: {what}." if where else f"{what}."


def quotable(text: str, most: int) -> str:
    """A client's text, quotable on one line: cut to `most` characters, with control sequences escaped."""
    text = text if len(text) <= most else f"{text[: most - 1]}…"
    return text if text.isprintable() else ascii(text)[1:-1]


@cache
def _adapter(kind: type[Any]) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
