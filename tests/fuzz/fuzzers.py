"""Decorators of fuzzers: how long they try, and examples; and what every refusal has to be: a sentence."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from hypothesis import HealthCheck, example, settings

EXAMPLES = "TIGAS_FUZZ_EXAMPLES"
"""The environment variable that `make fuzz` sets: how many examples each fuzzer tries."""
STEPS = 30
"""Of a state machine's example."""
CORPUS = Path(__file__).with_name("corpus")
"""Findings of fuzzers and people: a small file each, in a folder by kind, under a descriptive name."""
LONGEST = 400
"""Characters of a refusal; clients' data is quoted only in part."""
Fuzzer = TypeVar("Fuzzer", bound=Callable[..., Any])


def effort(examples: int = 50) -> settings:
    """Decorates a fuzzer; outside of `make fuzz` it tries a fixed number of deterministic examples."""
    long = os.environ.get(EXAMPLES)
    return settings(
        max_examples=int(long) if long else examples,
        derandomize=not long,
        print_blob=bool(long),
        database=settings().database if long else None,
        stateful_step_count=STEPS,
        suppress_health_check=(HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much),
    )


def found(kind: str, **arguments: Callable[[bytes], Any]) -> Callable[[Fuzzer], Fuzzer]:
    """Gives every file of a kind to a fuzzer as an example; `arguments` make the fuzzer's arguments of its content."""

    def adding(fuzzer: Fuzzer) -> Fuzzer:
        for file in sorted(CORPUS.joinpath(kind).iterdir()):
            fuzzer = example(**{name: make(file.read_bytes()) for name, make in arguments.items()})(fuzzer)
        return fuzzer

    return adding


def assert_sentence(detail: str) -> None:
    """One line that a person can read, and no traceback."""
    assert detail.endswith((".", "…")), detail
    assert detail.isprintable(), detail
    assert len(detail) <= LONGEST, detail
    assert "Traceback" not in detail
