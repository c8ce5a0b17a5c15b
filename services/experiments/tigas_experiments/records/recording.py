"""Reads a recording that the page hands over, and says what is wrong with one."""

from __future__ import annotations

from pydantic import ValidationError

from tigas_common.parsing import sentence
from tigas_common.wire.recording import MAX_BYTES, Recording


class BrokenRecording(Exception):
    """Why a recording cannot be used, in one sentence."""


def parse_recording(text: str | bytes) -> Recording:
    """Read one from the page's JSON. Raises BrokenRecording."""
    if len(text) > MAX_BYTES:
        raise BrokenRecording(f"The recording has {len(text)} bytes; the limit is {MAX_BYTES}.")
    try:
        return Recording.model_validate_json(text)
    except ValidationError as error:
        raise BrokenRecording(f"The page's recording cannot be used: {sentence(error)}") from None
