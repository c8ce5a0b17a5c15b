"""One port for all viewers: each datagram finds its connection, and unknown ones are dropped."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator

import pytest
from aioice import Connection, stun

from tests.dash.conftest import PATIENCE_S
from tigas_common.address import Address
from tigas_dash.webrtc.udp_port import MAX_PEERS, UdpPort

pytestmark = pytest.mark.anyio


@pytest.fixture
async def port() -> AsyncIterator[UdpPort]:
    async with UdpPort.listen(Address("127.0.0.1", 0)) as running:
        yield running


async def served(port: UdpPort) -> Connection:
    """The packager's end of a connection, which waits for its viewer."""
    connection = Connection(ice_controlling=False)
    port.attach(connection, lambda: None, lambda size: None)
    await connection.gather_candidates()
    return connection


async def viewed(ours: Connection, port: UdpPort) -> Connection:
    theirs = Connection(ice_controlling=True, use_ipv6=False)
    await theirs.gather_candidates()
    theirs.remote_username, theirs.remote_password = ours.local_username, ours.local_password
    ours.remote_username, ours.remote_password = theirs.local_username, theirs.local_password
    await theirs.add_remote_candidate(port.candidate("localhost"))
    await theirs.add_remote_candidate(None)
    return theirs


def binding(name: str) -> bytes:
    """A STUN binding request that names a connection, as anybody could send it."""
    message = stun.Message(stun.Method.BINDING, stun.Class.REQUEST)
    message.attributes["USERNAME"] = f"{name}:somebody"
    return bytes(message)


async def test_hostile_datagrams_are_dropped_and_addresses_bounded(port: UdpPort) -> None:
    ours = await served(port)
    theirs = await viewed(ours, port)
    known = binding(ours.local_username)
    wrong_priority = known[:2] + (len(known) - 20 + 8).to_bytes(2) + known[4:] + b"\x00\x24\x00\x02\x00\x00\x00\x00"
    for data in (b"", b"\x00\x01", b"\x00\x01" + bytes(18), known[:-3], b"\x80" * 1200, wrong_priority, b"\x16" * 40):
        port.datagram_received(data, ("127.0.0.1", 9), 0.0)
    port.datagram_received(binding("nobody"), ("127.0.0.1", 9), 0.0)
    for number in range(3 * MAX_PEERS):
        port.datagram_received(known, ("127.0.0.1", 10_000 + number), 0.0)
    assert len(port._by_peer) == MAX_PEERS
    async with asyncio.timeout(PATIENCE_S):
        await asyncio.gather(ours.connect(), theirs.connect())
    await ours.close()
    await theirs.close()
    assert not port._by_peer
    assert not port._by_username


@pytest.mark.parametrize(
    ("asked", "told"), [("localhost", "127.0.0.1"), ("labhost.local", "labhost.local"), ("192.0.2.7", "192.0.2.7")]
)
async def test_the_candidate_is_where_the_viewer_asked(port: UdpPort, asked: str, told: str) -> None:
    candidate = port.candidate(asked)
    assert (candidate.host, candidate.port, candidate.type) == (told, port.number, "host")


@pytest.mark.parametrize(("bound", "told"), [("0.0.0.0", "127.0.0.1"), ("::", "127.0.0.1"), ("::1", "::1")])
async def test_on_this_machine_the_candidate_is_an_address_that_the_port_has(
    port: UdpPort, monkeypatch: pytest.MonkeyPatch, bound: str, told: str
) -> None:
    monkeypatch.setattr(port, "host", bound)  # there may be no IPv6 here
    assert port.candidate("localhost").host == told


async def test_a_taken_port_is_an_error() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(OSError, match="in use"):
            async with UdpPort.listen(Address("127.0.0.1", taken.getsockname()[1])):
                pass
