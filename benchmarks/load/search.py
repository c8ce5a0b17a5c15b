"""How the largest number of viewers is looked for: doubled until it is too many, then halved between."""

from __future__ import annotations

from collections.abc import Generator

PRECISION = 0.05
"""Within which the number is found, as a share of it."""


def search(first: int, most: int) -> Generator[int, bool, int]:
    """Yields numbers of viewers to try, and is sent whether each is served properly.

    Returns the largest served number, 0 if there was none. Tries none above `most`, and none twice.
    """
    good, bad, count = 0, most + 1, min(first, most)
    doubling = True
    while bad - good > max(1, round(PRECISION * good)):
        if (yield count):
            good = count
        else:
            bad, doubling = count, False
        count = min(2 * good, most) if doubling else (good + bad) // 2
    return good
