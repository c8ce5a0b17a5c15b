"""The network-namespace lab as fixtures. Everything is made here and removed here."""

from __future__ import annotations

import itertools
import os
import platform
import shutil
from collections.abc import Iterator

import pytest

from tests.testbed.inside import root
from tests.testbed.shaper_process import ShaperProcess, shaper
from tigas_common.errors import StartError
from tigas_testbed.namespaces import Lab, sweep
from tigas_testbed.services import PORTS

_numbers = itertools.count()


def _missing() -> str | None:
    if platform.system() != "Linux":
        return "network namespaces exist on Linux only"
    if not root():
        return "making network namespaces needs root"
    tools = [tool for tool in ("ip", "tc", "nft", "ethtool", "setpriv", "sysctl") if shutil.which(tool) is None]
    return f"these tools are not installed: {', '.join(tools)}" if tools else None


@pytest.fixture(scope="session", autouse=True)
def can_make_labs() -> None:
    """Skips where the rights or the tools are missing, and removes what killed test runs left behind."""
    if missing := _missing():
        pytest.skip(missing)
    try:
        with Lab(f"t{os.getpid()}x").up():
            pass
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
