"""The network-namespace lab as fixtures. Everything is made here and removed here."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.prerequisites import NAMESPACES
from tests.testbed.labs import ShaperProcess, new_lab, remove_abandoned, shaper
from tigas_testbed.namespaces import Lab
from tigas_testbed.services import PORTS


@pytest.fixture(scope="session", autouse=True)
def can_make_labs() -> None:
    """Require network namespaces, and remove the labs of killed test runs."""
    NAMESPACES.require()
    remove_abandoned()


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    """A lab for the tests of one file."""
    with new_lab().up(PORTS) as made:
        yield made


@pytest.fixture(scope="module")
def link(lab: Lab) -> Iterator[ShaperProcess]:
    with shaper(lab) as running:
        yield running


@pytest.fixture
def own_lab() -> Iterator[Lab]:
    """A lab for one test, which may break it."""
    with new_lab().up(PORTS) as made:
        yield made
