"""Offers and datagrams that anybody may send: each is answered, refused in a sentence, or dropped."""

from __future__ import annotations

import asyncio

from aioice import Connection, stun
from hypothesis import given
from hypothesis import strategies as st

from tests.dash.webrtc.viewer import offer_of_nobody
from tests.fuzz.byte_edits import edited
from tests.fuzz.fuzzers import assert_sentence, effort
from tigas_common.address import Address
from tigas_common.errors import InvalidRequest
from tigas_dash.clock import Clock
from tigas_dash.stream import Progress
from tigas_dash.webrtc.offer import accept_offer, create_answer
from tigas_dash.webrtc.track import ViewTrack
from tigas_dash.webrtc.udp_port import UdpPort

PIECES = (b"\r\n", b"m=video 9 X 1\r\n", b"a=mid:0\r\n", b"a=rtpmap:", b"a=fmtp:97 ", b"a=ice-pwd:\r\n", b"9" * 40)


class NoViews:
    """The track is never asked for a frame."""

    newest = None


async def negotiate(offer: str) -> None:
    async with UdpPort.listen(Address("127.0.0.1", 0)) as port, accept_offer(offer) as connection:
        assert connection.sctp is not None
        lane = port.attach(connection.sctp.transport.transport.iceGatherer._connection, lambda: None, lambda size: None)
        track = ViewTrack(NoViews(), 30, Clock(), Progress(), lambda *_: None)  # type: ignore[arg-type]
        try:
            sdp, codec = await create_answer(connection, track, port.candidate("localhost").to_sdp())
            assert codec in ("VP8", "H264")
            assert f"127.0.0.1 {port.number} typ host" in sdp
            await connection.close()
        finally:
            lane.detach()


def test_any_offer_is_answered_or_refused_in_a_sentence() -> None:
    whole = asyncio.run(offer_of_nobody()).encode()

    @effort(30)
    @given(edited(st.just(whole), PIECES))
    def fuzz(offer: bytes) -> None:
        try:
            asyncio.run(negotiate(offer.decode(errors="replace")))
        except InvalidRequest as refused:
            assert_sentence(refused.detail)

    asyncio.run(negotiate(whole.decode()))
    fuzz()


def test_any_datagram_is_dropped_or_answered() -> None:
    async def all_of(datagrams: list[bytes], name: str) -> None:
        async with UdpPort.listen(Address("127.0.0.1", 0)) as port:
            connection = Connection(ice_controlling=False, local_username=name)
            port.attach(connection, lambda: None, lambda size: None)
            await connection.gather_candidates()
            for datagram in datagrams:
                port.datagram_received(datagram, ("127.0.0.1", 9), 0.0)
            await connection.close()

    message = stun.Message(stun.Method.BINDING, stun.Class.REQUEST)
    message.attributes |= {"USERNAME": "abcd:efgh", "PRIORITY": 7, "ICE-CONTROLLING": 5}
    message.add_message_integrity(b"secret")
    message.add_fingerprint()

    @effort(30)
    @given(
        st.lists(edited(st.just(bytes(message)), (b"\x00\x06\x00\x04", b"\x80\x28", b"\x00\x24\x00\x02")), max_size=8)
    )
    def fuzz(datagrams: list[bytes]) -> None:
        asyncio.run(all_of(datagrams, "abcd"))

    fuzz()
