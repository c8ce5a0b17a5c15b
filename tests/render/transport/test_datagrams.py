"""The render session over datagrams, as docs/protocol.md has it."""

from __future__ import annotations

import json
import random
import struct
from typing import Any, cast

import pytest

from tests.eventually import eventually
from tests.render.transport.client import FakeFrames, request_body
from tests.render.transport.serving import assemble, in_datagrams, in_session
from tigas.http3 import split_frame
from tigas_common.errors import InvalidRequest
from tigas_render.admission.connections import Usage
from tigas_render.admission.limits import Limits
from tigas_render.transport import sending
from tigas_render.transport.sending import FRAGMENT_HEADER, DatagramSender, SendScheduler, split_into_datagrams

pytestmark = pytest.mark.anyio


async def test_a_frame_in_datagrams() -> None:
    source = FakeFrames(random.Random(3).randbytes(20_000))
    async with in_session(source) as (_, client, session):
        client.send_datagram(4 * 1000, request_body(seq=5))  # of no session: dropped
        for seq in (1, 2**32 - 1):
            client.send_datagram(session, request_body(seq=seq))
            header, body = split_frame(await in_datagrams(client, seq))
            assert (header["status"], header["seq"]) == (200, seq)
            assert body == source.body
        sizes = [len(datagram) for datagram in client.datagrams if struct.unpack_from("!I", datagram)[0] == 1]
    assert len(set(sizes[:-1])) == 1, "all but the last have the same length"
    assert sizes[-1] <= sizes[0] > 1350, "fragments fill their packets"
    assert [request.seq for _, request in source.requests] == [1, 2**32 - 1]


@pytest.mark.parametrize("body", [b"", b"\0", b"[" * 1000, request_body(seq=0, fx=0)])
async def test_a_malformed_datagram_is_a_problem(body: bytes) -> None:
    async with in_session(FakeFrames()) as (_, client, session):
        client.send_datagram(session, body)
        assert split_frame(await in_datagrams(client, 0))[0]["status"] == 400
        assert (await client.frame(session, request_body()))[0]["status"] == 200


@pytest.mark.parametrize("size", [32, 100])
async def test_a_client_whose_datagrams_are_too_small_for_frames_is_referred_to_streams(size: int) -> None:
    source = FakeFrames(bytes(70_000))
    async with in_session(source, max_datagram=size) as (_, client, session):
        client.send_datagram(session, request_body(seq=7))
        header, body = split_frame(await in_datagrams(client, 7))
        assert (header["status"], header["seq"]) == (400, 7)
        assert "send the request on a stream" in json.loads(body)["detail"]
        assert source.requests == [], "nothing is rendered in vain"
        assert (await client.frame(session, request_body()))[1] == source.body


async def test_a_frame_that_takes_too_many_datagrams_is_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sending, "MAX_FRAGMENTS", 10)
    async with in_session(FakeFrames(bytes(70_000))) as (_, client, session):
        client.send_datagram(session, request_body(seq=7))
        header, body = split_frame(await in_datagrams(client, 7))
    assert (header["status"], header["seq"]) == (400, 7)
    assert "does not fit" in json.loads(body)["detail"]


async def test_unsent_fragments_make_way_for_a_newer_frame() -> None:
    """A frame of 4 MB does not fit the network's window; a newer one overtakes it at once."""
    source = FakeFrames(bytes(4_000_000))
    async with in_session(source) as (server, client, session):
        client.send_datagram(session, request_body(seq=1))
        await client.until(lambda: client.datagrams)
        (connection,) = server._connections
        assert len(connection._quic._datagrams_pending) < 200, "QUIC has no more than it can send soon"
        source.body = b"new"
        client.send_datagram(session, request_body(seq=2))
        await in_datagrams(client, 2)
        assert assemble(client.datagrams)[1] is None
        header, body = await client.frame(session, request_body(seq=3))
        assert (header["seq"], body) == (3, b"new"), "nothing stays in the way of streams"
        (_, _, count) = struct.unpack_from("!IHH", client.datagrams[0])
        assert len(client.datagrams) < count


async def test_a_flood_of_datagrams_is_bounded() -> None:
    source = FakeFrames()
    source.held = True
    async with in_session(source) as (_, client, session):
        for seq in range(1, 41):
            client.send_datagram(session, request_body(seq=seq))
        await client.until(lambda: len(client.datagrams) >= 40 - 16)
        statuses = {split_frame(body)[0]["status"] for body in assemble(client.datagrams).values() if body}
        assert statuses == {503}
        assert len(source.requests) == 16
        client.send(session, b"", end=True)
        await eventually(lambda: len(source.cancelled) == 16)


@pytest.mark.parametrize(("length", "count"), [(0, 1), (1, 1), (100, 1), (101, 2), (200, 2), (250, 3)])
def test_fragments_carry_everything(length: int, count: int) -> None:
    answer = bytes(range(length))
    pieces = split_into_datagrams(7, answer, max_datagram=100 + FRAGMENT_HEADER.size)
    assert [FRAGMENT_HEADER.unpack_from(piece) for piece in pieces] == [(7, n, count) for n in range(count)]
    assert b"".join(piece[FRAGMENT_HEADER.size :] for piece in pieces) == answer
    assert all(len(piece) == 108 for piece in pieces[:-1])


def test_too_many_fragments_are_refused() -> None:
    assert len(split_into_datagrams(0, bytes(65_535), max_datagram=9)) == 65_535
    with pytest.raises(InvalidRequest, match="65,535"):
        split_into_datagrams(0, bytes(65_536), max_datagram=9)


class Network:
    """The part of a connection used by a sender; it takes as many datagrams as a test allows."""

    max_datagram_payload = 116

    def __init__(self) -> None:
        self.sendable_datagrams = 0
        self.sent: list[tuple[int, ...]] = []

    def send_datagram_frame(self, data: bytes) -> None:
        self.sendable_datagrams -= 1
        self.sent.append(FRAGMENT_HEADER.unpack_from(data, 1))


class Session:
    """A session with the id 0 on such a network."""

    def __init__(self) -> None:
        self.network = Network()
        self.scheduler = SendScheduler(
            cast(Any, self.network), cast(Any, None), Limits(), Usage("address"), lambda: None
        )
        self.datagrams = DatagramSender(self.scheduler, 0)

    def sends(self, room: int) -> list[tuple[int, ...]]:
        """Datagrams sent with this much room: seq, fragment and number of fragments of each."""
        self.network.sendable_datagrams, self.network.sent = room, []
        self.scheduler.flush()
        return self.network.sent


def test_only_the_newest_frame_waits() -> None:
    session = Session()
    first, second, third = (session.datagrams.next_request_number() for _ in range(3))
    session.datagrams.send_frame(first, 1, bytes(1000))
    assert session.sends(room=1) == [(1, 0, 10)]
    session.datagrams.send_frame(third, 3, bytes(150))
    session.datagrams.send_frame(second, 2, bytes(150))  # an older frame that is ready later is not sent at all
    assert session.sends(room=9) == [(3, 0, 2), (3, 1, 2)], "the rest of the older frame is dropped"


def test_a_problem_goes_first_and_drops_no_frame() -> None:
    session = Session()
    session.datagrams.send_frame(session.datagrams.next_request_number(), 1, bytes(150))
    session.datagrams.send_error(2, bytes(50))
    assert session.sends(room=9) == [(2, 0, 1), (1, 0, 2), (1, 1, 2)]


def test_what_the_path_no_longer_carries_holds_up_nothing() -> None:
    session = Session()
    session.datagrams.send_frame(session.datagrams.next_request_number(), 1, bytes(150))
    session.network.max_datagram_payload = 60
    session.datagrams.send_error(2, bytes(40))
    assert session.sends(room=9) == [(2, 0, 1), (1, 1, 2)]
