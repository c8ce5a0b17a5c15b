"""Requirements of a refusal: one sentence."""

from __future__ import annotations

LONGEST = 400
"""Characters; clients' data is quoted only in part."""


def assert_sentence(detail: str) -> None:
    """One line that a person can read, and no traceback."""
    assert detail.endswith((".", "…")), detail
    assert detail.isprintable(), detail
    assert len(detail) <= LONGEST, detail
    assert "Traceback" not in detail
