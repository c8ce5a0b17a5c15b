"""Messages between processes."""

from __future__ import annotations

import asyncio
import socket

import pytest

from tigas_render.workers.control import MAX_UNSENT, Channel, NewCertificate, TicketTaken

pytestmark = pytest.mark.anyio


async def test_a_message_that_its_sender_did_not_end_is_none() -> None:
    ours, theirs = socket.socketpair()
    channel = await Channel.from_socket(ours)
    theirs.sendall(NewCertificate(pem=b"new").model_dump_json().encode() + b'\n{"kind": "ready", "li')
    theirs.close()
    async with asyncio.timeout(20):
        assert [message async for message in channel] == [NewCertificate(pem=b"new")]
    await channel.close()


async def test_tickets_are_dropped_and_a_renewed_certificate_is_not() -> None:
    ours, theirs = [await Channel.from_socket(sock) for sock in socket.socketpair()]
    ticket = TicketTaken(label=bytes(10_000))
    sent = 1000
    assert sent * len(ticket.label) > 2 * MAX_UNSENT
    for _ in range(sent):
        ours.send(ticket)
    ours.send(NewCertificate(pem=b"new"))
    heard = []
    async with asyncio.timeout(20):
        async for message in theirs:
            heard.append(message)
            if isinstance(message, NewCertificate):
                break
    assert heard[-1] == NewCertificate(pem=b"new")
    assert len(heard) - 1 < sent
    await ours.close()
    await theirs.close()
