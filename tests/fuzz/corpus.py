"""Findings of fuzzers and people: a small file each, in a folder by kind, under a descriptive name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from hypothesis import example

CORPUS = Path(__file__).with_name("corpus")
Fuzzer = TypeVar("Fuzzer", bound=Callable[..., Any])


def found(kind: str, **arguments: Callable[[bytes], Any]) -> Callable[[Fuzzer], Fuzzer]:
    """Gives every file of a kind to a fuzzer as an example; `arguments` make the fuzzer's arguments of its content."""

    def adding(fuzzer: Fuzzer) -> Fuzzer:
        for file in sorted(CORPUS.joinpath(kind).iterdir()):
            fuzzer = example(**{name: make(file.read_bytes()) for name, make in arguments.items()})(fuzzer)
        return fuzzer

    return adding
