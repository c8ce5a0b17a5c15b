"""The order of handling datagrams."""

from __future__ import annotations

from tigas_render.transport.inbox import MAX_WAITING, Inbox, Received

FLOOD, POLITE = ("192.0.2.1", 1000), ("192.0.2.2", 1000)


def received(address: tuple[str, int], number: int = 0) -> Received:
    return Received(str(number).encode(), address, 0.0)


def take(inbox: Inbox) -> tuple[str, Received]:
    taken = inbox.take()
    assert taken is not None
    return taken


def test_datagrams_are_handled_in_the_order_of_their_arrival() -> None:
    inbox = Inbox()
    for number in range(40):
        inbox.add(received(POLITE, number))
    taken: list[bytes] = []
    while inbox:
        network, datagram = take(inbox)
        assert network == POLITE[0]
        taken.append(datagram.data)
    assert taken == [str(number).encode() for number in range(40)]
    assert inbox.take() is None


def test_a_flood_holds_nobody_else_up() -> None:
    inbox = Inbox()
    for number in range(300):
        inbox.add(received(FLOOD, number))
    inbox.add(received(POLITE))
    turns = [take(inbox)[0] for _ in range(2)]
    assert POLITE[0] in turns


def test_whoever_costs_more_time_gets_fewer_turns() -> None:
    inbox = Inbox()
    for number in range(500):
        inbox.add(received(FLOOD, number))
        inbox.add(received(POLITE, number))
    turns = []
    for _ in range(20):
        network, _ = take(inbox)
        turns.append(network)
        inbox.settle(network, 0.009 if network == FLOOD[0] else 0.001)
    assert turns.count(FLOOD[0]) in (2, 3)


def test_a_flood_is_cut_for_its_sender_alone() -> None:
    inbox = Inbox()
    for number in range(2 * MAX_WAITING):
        inbox.add(received(FLOOD, number))
    inbox.add(received(POLITE))
    handled = [take(inbox)[1].address for _ in range(MAX_WAITING + 1)]
    assert not inbox
    assert (handled.count(FLOOD), handled.count(POLITE)) == (MAX_WAITING, 1)


def test_ports_and_mapped_addresses_are_one_sender() -> None:
    inbox = Inbox()
    for address in (("192.0.2.1", 1), ("::ffff:192.0.2.1", 2, 0, 0), ("192.0.2.1", 3)):
        inbox.add(Received(b"", address, 0.0))
    assert [take(inbox)[0] for _ in range(3)] == ["192.0.2.1"] * 3


def test_who_had_enough_is_passed_over() -> None:
    inbox = Inbox()
    inbox.add(received(FLOOD))
    assert inbox.take({FLOOD[0]}) is None
    inbox.add(received(POLITE))
    assert take(inbox)[0] == FLOOD[0]
    inbox.add(received(FLOOD))
    taken = inbox.take({FLOOD[0]})
    assert taken is not None
    assert taken[0] == POLITE[0]
