"""Tests with browsers come last, however they are named."""

from __future__ import annotations

import subprocess
import sys

from tests.prerequisites import ROOT


def test_browsers_come_after_tests_that_need_a_new_event_loop() -> None:
    named = ["tests/web/test_first_screen.py", "tests/shaper/test_player.py"]
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider", "-m", "", *named]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    files = [line.partition("::")[0] for line in listed if "::" in line]
    assert files == sorted(files)
    assert set(files) == set(named)
