"""The stream's time does not jump when the machine's clock is set."""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta

import pytest

from tigas_dash.clock import Clock, iso


def test_wall_clock_time_follows_the_steady_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    steady = 1000.0
    monkeypatch.setattr(time, "monotonic", lambda: steady)
    clock = Clock(datetime(2026, 1, 31, 12, tzinfo=UTC), steady)
    monkeypatch.setattr(time, "time", lambda: 0.0)  # the system clock is changed
    steady += 61.5
    assert clock.wall(clock.now()) == datetime(2026, 1, 31, 12, 1, 1, 500_000, tzinfo=UTC)


def test_is_written_as_the_manifest_asks_for_it() -> None:
    assert iso(datetime(2026, 1, 31, 12, tzinfo=UTC) + timedelta(microseconds=1500)) == "2026-01-31T12:00:00.001Z"
