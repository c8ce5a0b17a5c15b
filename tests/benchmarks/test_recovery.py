"""What a recording tells of breaks, and how modes are compared by it."""

from __future__ import annotations

import pytest

from benchmarks.recovery import CLEAN_S, END_S, FIGURES, KILL_S, LOSSY_S, Run, figures, table

KILLED_MS, ENDED_MS = KILL_S * 1000, END_S * 1000


def shown(*gaps: tuple[float, float]) -> list[float]:
    """A new view every 20 ms, but none in these gaps, from and to, in ms."""
    times = [20.0 * number for number in range(int(ENDED_MS / 20))]
    return [at for at in times if not any(begin < at < end for begin, end in gaps)]


def test_a_stretch_knows_nothing_of_what_happens_in_another() -> None:
    lossy = 1000 * (LOSSY_S + CLEAN_S) / 2
    found = dict(
        zip(
            FIGURES,
            figures(shown((lossy, lossy + 300), (KILLED_MS, KILLED_MS + 500)), KILLED_MS, ENDED_MS),
            strict=True,
        )
    )
    assert found["new views a second, nothing lost"] == pytest.approx(50)
    assert found["new views a second, 1 % lost"] < 47
    assert found["picture stands still, nothing lost, p99, ms"] == 20
    assert found["picture stands still, engine killed, ms"] == 500


def test_a_view_that_never_comes_again_is_missed_until_the_end() -> None:
    *_, stood_still = figures(shown((KILLED_MS, ENDED_MS)), KILLED_MS, ENDED_MS)
    assert stood_still == pytest.approx(ENDED_MS - KILLED_MS, abs=20)


def test_ratios_are_of_blocks_that_both_modes_have() -> None:
    one = [Run("stateless", 20, block, (10.0 + block,) * len(FIGURES)) for block in range(6)]
    other = [Run("video", 20, block, (20.0 + 2 * block,) * len(FIGURES)) for block in range(7)]
    lines = list(table([*one, *other]))
    assert len(lines) == 2 + len(FIGURES), "none at a round trip without runs"
    assert all(line.endswith("| 2.00 [2.00, 2.00] |") for line in lines[2:])
