"""A port that another program has is reported before anything that takes time."""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.prerequisites import IPV6
from tigas_common.address import Address
from tigas_common.errors import StartError
from tigas_common.topology import Port
from tigas_dash import main as dash
from tigas_dash.settings import DashSettings
from tigas_experiments.store import main as store
from tigas_experiments.store.settings import StoreSettings
from tigas_testbed.services import check_ports_free

pytestmark = pytest.mark.anyio


@pytest.fixture
def taken() -> Iterator[Address]:
    """The address of another program."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield Address("127.0.0.1", listener.getsockname()[1])


async def test_the_packager_says_so_before_it_tries_encoders(taken: Address, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dash, "choose_encoder", lambda _: pytest.fail("It has tried encoders."))
    with pytest.raises(StartError, match=r"Cannot listen on .+ \(Address already in use\)"):
        await dash.serve(DashSettings(http=taken))


async def test_the_store_says_so_before_it_makes_its_directory(taken: Address, tmp_path: Path) -> None:
    with pytest.raises(StartError, match=r"Cannot listen on .+ \(Address already in use\)"):
        await store.serve(StoreSettings(http=taken, results=tmp_path / "results"))
    assert not (tmp_path / "results").exists()


def test_the_lab_says_so_before_it_is_built(taken: Address) -> None:
    with pytest.raises(StartError, match=f"needs tcp port {taken} "):
        check_ports_free([Port("tcp", taken.port)])
    check_ports_free([Port("udp", taken.port)])


@IPV6.mark
def test_the_lab_says_so_if_only_a_browser_s_first_choice_is_taken() -> None:
    with socket.create_server(("::1", 0), family=socket.AF_INET6) as listener:
        port = Port("tcp", listener.getsockname()[1])
        with pytest.raises(StartError, match=rf"needs tcp port \[::1\]:{port.number} \(Address already in use\)"):
            check_ports_free([port])
        check_ports_free([Port("udp", port.number)])


def test_the_lab_does_without_ipv6(monkeypatch: pytest.MonkeyPatch, taken: Address) -> None:
    make_socket = socket.socket

    def ipv4_only(family: int, kind: int) -> socket.socket:
        if family == socket.AF_INET6:
            raise OSError(errno.EAFNOSUPPORT, "Address family not supported by protocol")
        return make_socket(family, kind)

    monkeypatch.setattr(socket, "socket", ipv4_only)
    check_ports_free([Port("udp", taken.port)])
