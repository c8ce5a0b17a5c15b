"""Fixtures for every test."""

from __future__ import annotations

import signal

import pytest


def pytest_configure() -> None:
    """Answer Ctrl+C: in the background of a script it is ignored, and so it would be by all that the tests start."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def anyio_backend() -> str:
    """Async tests run on asyncio, as the services do."""
    return "asyncio"
