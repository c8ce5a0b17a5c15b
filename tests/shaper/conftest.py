"""A link that only remembers, and a time that tests advance."""

from __future__ import annotations

import pytest

from tests.shaper.fakes import FakeLink, FakeTime


@pytest.fixture
def time() -> FakeTime:
    return FakeTime()


@pytest.fixture
def link(time: FakeTime) -> FakeLink:
    return FakeLink(time)
