"""Tests are skipped only when a prerequisite of the table is missing."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests import prerequisites

TESTS = Path(__file__).parent
HERE = {Path(__file__), Path(prerequisites.__file__)}
MISSING = """
import pytest
from tests.prerequisites import Prerequisite
ABSENT = Prerequisite("a teapot", "buy one", lambda: False)

@ABSENT.mark
@pytest.mark.parametrize("cups", [1, 2])
def test_marked(cups): ...

def test_requiring():
    ABSENT.require()
"""
pytest_plugins = ["pytester"]


def test_every_skip_names_a_prerequisite() -> None:
    skips = re.compile(r"pytest\.skip\(|mark\.skip|importorskip|xfail|flaky")
    found = [path for path in TESTS.rglob("*.py") if path not in HERE and skips.search(path.read_text())]
    assert found == []


def test_the_summary_has_one_line_for_each_missing_prerequisite(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(TESTS.parent))
    pytester.makeconftest((TESTS / "conftest.py").read_text())
    pytester.makepyfile(MISSING)
    run = pytester.runpytest_subprocess(f"--rootdir={TESTS.parent}", "-p", "no:cacheprovider")
    run.assert_outcomes(skipped=3)
    run.stdout.fnmatch_lines(["SKIPPED 3 tests that need a teapot: buy one"])
