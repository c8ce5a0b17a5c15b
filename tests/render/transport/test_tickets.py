"""Session tickets are good once, and there are never too many."""

from __future__ import annotations

from datetime import UTC, datetime

from aioquic.tls import CipherSuite, SessionTicket

from tigas_render.transport.tickets import TicketStore


def ticket(label: bytes) -> SessionTicket:
    now = datetime.now(UTC)
    return SessionTicket(
        age_add=0,
        cipher_suite=CipherSuite.AES_128_GCM_SHA256,
        not_valid_after=now,
        not_valid_before=now,
        resumption_secret=b"",
        server_name="",
        ticket=label,
    )


def test_a_ticket_is_taken_once() -> None:
    store = TicketStore()
    store.add(ticket(b"a"))
    assert store.take(b"b") is None
    assert store.take(b"a") is not None
    assert store.take(b"a") is None


def test_the_oldest_make_room() -> None:
    store = TicketStore(capacity=3)
    for label in (b"1", b"2", b"3", b"4"):
        store.add(ticket(label))
    assert len(store) == 3
    assert store.take(b"1") is None
    assert store.take(b"4") is not None
