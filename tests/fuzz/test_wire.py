"""Any bytes are parsed as a wire type or refused in one sentence, within bounded memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given

from tests.fuzz.fuzzers import assert_sentence, effort, found
from tests.fuzz.json_texts import bodies, dumps
from tests.fuzz.wire_examples import EXAMPLES
from tigas_common.errors import BodyTooLarge, InvalidRequest
from tigas_common.parsing import MAX_BODY, parse

MOST_MEMORY = 400
"""Bytes that a body's byte may take while it is checked."""


@pytest.mark.parametrize("kind", EXAMPLES, ids=lambda kind: kind.__name__)
def test_the_examples_are_accepted(kind: Any) -> None:
    for example in EXAMPLES[kind]:
        assert parse(kind, dumps(example).encode(), limit=10 * MAX_BODY)


@pytest.mark.parametrize("kind", EXAMPLES, ids=lambda kind: kind.__name__)
def test_any_body_is_read_or_refused_in_a_sentence_in_bounded_memory(kind: Any) -> None:
    @effort()
    @given(body=bodies(kind, EXAMPLES[kind]))
    @found("body", body=bytes)
    def fuzz(body: bytes) -> None:
        tracemalloc.start()
        try:
            message = parse(kind, body, limit=10 * MAX_BODY)
        except (InvalidRequest, BodyTooLarge) as error:
            assert_sentence(error.detail)
        else:
            properties(message)
        finally:
            _, peak = tracemalloc.get_traced_memory()
            tracemalloc.stop()
        assert peak < MOST_MEMORY * (len(body) + 1000)

    fuzz()


def properties(message: Any) -> None:
    """Ask for all that a message can compute of itself."""
    for name, member in vars(type(message)).items():
        if isinstance(member, property):
            getter: Callable[[Any], Any] | None = member.fget
            assert getter is not None
            try:
                getter(message)
            except ValueError as error:
                raise AssertionError(f"{name} of what was accepted: {error}") from error
