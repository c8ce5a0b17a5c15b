"""Fixtures for every test."""

from __future__ import annotations

import signal

import pytest
from hypothesis import settings


def pytest_configure() -> None:
    """Let properties take their time, and answer Ctrl+C.

    In the background of a script it is ignored, and so it would be by all that the tests start.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    settings.register_profile("tigas", deadline=None)  # a busy machine is slow
    settings.load_profile("tigas")


@pytest.fixture
def anyio_backend() -> str:
    """Async tests run on asyncio, as the services do."""
    return "asyncio"
