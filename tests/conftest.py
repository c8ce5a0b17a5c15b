"""Tiers of the tests, the summary of skipped tests, and fixtures for every test."""

from __future__ import annotations

import os
import signal
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import settings

from tests.prerequisites import ROOT

SLOW_FOLDERS = tuple(f"{ROOT}/tests/{name}/" for name in ("compose", "testbed", "web"))
"""Containers, network namespaces and browsers: all tests there are slow."""
BROWSERS = f"{ROOT}/tests/web/"
"""A process that has driven browsers here runs no asyncio tests any more."""


def pytest_configure(config: pytest.Config) -> None:
    """Let properties take their time, answer Ctrl+C, and leave the user's cache of previews alone.

    A script's background job ignores Ctrl+C, and so would every process that the tests start.
    """
    if not hasattr(config, "workerinput"):
        cache = TemporaryDirectory(prefix="tigas-cache-")
        config.add_cleanup(cache.cleanup)
        Path(cache.name).chmod(0o777)  # some services run as another user
        os.environ["TIGAS_RENDER_CACHE"] = cache.name
    signal.signal(signal.SIGINT, signal.default_int_handler)
    settings.register_profile("tigas", deadline=None)  # a busy machine is slow
    settings.load_profile("tigas")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark whole folders as slow, before `-m` selects, and put browsers last."""
    for item in items:
        if str(item.path).startswith(SLOW_FOLDERS):
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: str(item.path).startswith(BROWSERS))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Summarise skipped tests in one line for each missing prerequisite."""
    skipped = Counter(report.longrepr[2].removeprefix("Skipped: ") for report in terminalreporter.getreports("skipped"))
    for reason, count in skipped.most_common():
        terminalreporter.write_line(f"SKIPPED {count} tests that need {reason}", yellow=True)


@pytest.fixture
def anyio_backend() -> str:
    """Async tests run on asyncio, as the services do."""
    return "asyncio"
