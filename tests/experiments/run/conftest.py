"""An environment that only pretends."""

from __future__ import annotations

import pytest

from tests.experiments.run.stub import Stub, installed


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Stub:
    """In place of services and browser."""
    return installed(monkeypatch)
