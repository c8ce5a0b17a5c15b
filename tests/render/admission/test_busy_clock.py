"""Definition of busy time."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from tigas_render.admission import busy_clock
from tigas_render.admission.busy_clock import busy_time


def test_computing_counts_and_sleeping_does_not() -> None:
    before, computed = busy_time(), time.thread_time()
    while time.thread_time() < computed + 0.05:
        pass
    between = busy_time()
    assert between - before >= 0.045
    time.sleep(0.3)
    assert busy_time() - between < 0.25


def test_waiting_for_a_processor_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(busy_clock, "SCHEDSTAT", tmp_path / "schedstat")
    (tmp_path / "schedstat").write_text("2000000000 3500000000 17\n")
    assert busy_time() == 5.5


def test_without_the_kernels_word_only_computing_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(busy_clock, "SCHEDSTAT", tmp_path / "none")
    assert busy_time() == pytest.approx(time.thread_time(), abs=0.1)
