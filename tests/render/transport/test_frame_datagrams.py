"""The render session over datagrams, as docs/protocol.md has it."""

from __future__ import annotations

import json
import random
import struct

import pytest

from tests.render.transport.client import FakeFrames, eventually, request_body
from tests.render.transport.serving import assemble, in_datagrams, in_session
from tigas.http3 import split_frame
from tigas_render.transport import datagrams

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
    monkeypatch.setattr(datagrams, "MAX_FRAGMENTS", 10)
    async with in_session(FakeFrames(bytes(70_000))) as (_, client, session):
        client.send_datagram(session, request_body(seq=7))
        header, body = split_frame(await in_datagrams(client, 7))
    assert (header["status"], header["seq"]) == (400, 7)
    assert "does not fit" in json.loads(body)["detail"]


async def test_an_older_frame_is_dropped_once_a_newer_one_was_answered() -> None:
    source = FakeFrames()
    source.held = {1, 2}
    async with in_session(source) as (_, client, session):
        for seq in (1, 2):
            client.send_datagram(session, request_body(seq=seq))
        await eventually(lambda: len(source.requests) == 2)
        source.release(2)
        await in_datagrams(client, 2)
        source.release(1)
        client.send_datagram(session, request_body(seq=3))
        await in_datagrams(client, 3)
        assert 1 not in assemble(client.datagrams)


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
