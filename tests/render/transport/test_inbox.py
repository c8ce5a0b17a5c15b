"""The order of handling datagrams."""

from __future__ import annotations

from tigas_render.transport.inbox import MAX_WAITING, Inbox, ReceivedDatagram

FLOOD, POLITE = ("192.0.2.1", 1000), ("192.0.2.2", 1000)


def inbox(**counts: int) -> Inbox:
    """With this many datagrams of each."""
    inbox = Inbox()
    for number in range(max(counts.values())):
        for address in (FLOOD, POLITE):
            if number < counts["flood" if address == FLOOD else "polite"]:
                inbox.add(b"%d" % number, address, 0.0)
    return inbox


def take(inbox: Inbox) -> tuple[str, ReceivedDatagram]:
    taken = inbox.pop()
    assert taken is not None
    return taken


def test_datagrams_are_handled_in_the_order_of_their_arrival() -> None:
    waiting = inbox(flood=0, polite=40)
    taken = [take(waiting) for _ in range(40)]
    assert [(network, datagram.data) for network, datagram in taken] == [(POLITE[0], b"%d" % n) for n in range(40)]
    assert not waiting
    assert waiting.pop() is None


def test_a_flood_holds_nobody_else_up() -> None:
    waiting = inbox(flood=300, polite=1)
    assert POLITE[0] in [take(waiting)[0] for _ in range(2)]


def test_whoever_costs_more_time_gets_fewer_turns() -> None:
    waiting = inbox(flood=500, polite=500)
    turns = []
    for _ in range(20):
        network, _ = take(waiting)
        turns.append(network)
        waiting.charge(network, 0.009 if network == FLOOD[0] else 0.001)
    assert turns.count(FLOOD[0]) in (2, 3)


def test_a_flood_is_cut_for_its_sender_alone() -> None:
    waiting = inbox(flood=2 * MAX_WAITING, polite=1)
    handled = [take(waiting)[1].address for _ in range(MAX_WAITING + 1)]
    assert not waiting
    assert (handled.count(FLOOD), handled.count(POLITE)) == (MAX_WAITING, 1)


def test_ports_and_mapped_addresses_are_one_sender() -> None:
    waiting = Inbox()
    for address in (("192.0.2.1", 1), ("::ffff:192.0.2.1", 2, 0, 0), ("192.0.2.1", 3)):
        waiting.add(b"", address, 0.0)
    assert [take(waiting)[0] for _ in range(3)] == ["192.0.2.1"] * 3


def test_who_had_enough_is_passed_over() -> None:
    waiting = inbox(flood=1, polite=0)
    assert waiting.pop({FLOOD[0]}) is None
    waiting.add(b"", POLITE, 0.0)
    assert take(waiting)[0] == FLOOD[0]
    waiting.add(b"", FLOOD, 0.0)
    taken = waiting.pop({FLOOD[0]})
    assert taken is not None
    assert taken[0] == POLITE[0]
