"""The network-namespace lab as fixtures. Everything is made here and removed here."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator

import pytest

from tests.testbed.shaper_process import ShaperProcess, shaper
from tigas_common.errors import StartError
from tigas_testbed.namespaces import Lab, check_rights, sweep
from tigas_testbed.services import PORTS

_numbers = itertools.count()


@pytest.fixture(scope="session", autouse=True)
def can_make_labs() -> None:
    """Skips where the rights or the tools for a lab are missing, and removes what killed test runs left behind."""
    try:
        check_rights()
    except StartError as error:
        pytest.skip(str(error))
    sweep("t")


def _lab() -> Lab:
    return Lab(f"t{os.getpid()}n{next(_numbers)}")


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    """A lab for the tests of one file."""
    with _lab().up(PORTS) as made:
        yield made


@pytest.fixture(scope="module")
def link(lab: Lab) -> Iterator[ShaperProcess]:
    """A shaper on its gateway."""
    with shaper(lab) as running:
        yield running


@pytest.fixture
def own_lab() -> Iterator[Lab]:
    """A lab for one test, which may break it."""
    with _lab().up(PORTS) as made:
        yield made
