"""How long a fuzzer tries: the same few examples in every `make test`, many random ones with `make fuzz`."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

EXAMPLES = "TIGAS_FUZZ_EXAMPLES"
"""The environment variable that `make fuzz` sets: how many examples each fuzzer tries."""
STEPS = 30
"""Of a state machine's example."""


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
