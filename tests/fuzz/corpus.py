"""Findings of fuzzers and people: a small file each, in a folder by kind, under a descriptive name."""

from __future__ import annotations

from pathlib import Path

import pytest

CORPUS = Path(__file__).with_name("corpus")


def found(kind: str) -> pytest.MarkDecorator:
    """Parametrises a test with the `content` of every file of a kind."""
    files = sorted(CORPUS.joinpath(kind).iterdir())
    return pytest.mark.parametrize("content", [pytest.param(file.read_bytes(), id=file.name) for file in files])
