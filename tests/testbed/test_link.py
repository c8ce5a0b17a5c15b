"""Traffic across the link, against its trace and its settings."""

from __future__ import annotations

import itertools
import math
import socket
import statistics
import subprocess
import time
from contextlib import suppress

import pytest

from tests.eventually import wait_until
from tests.testbed.conftest import ShaperProcess
from tests.testbed.inside import (
    GATEWAY,
    LAYER_2,
    Receiver,
    echo_server,
    flood,
    retried_on_a_busy_machine,
    server_socket,
    udp,
)
from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.trace import NetworkTrace

pytestmark = pytest.mark.alone

SIZE = 1400
PEAK = 40_000.0
UDP_SEGMENT = 103


def trace(name: str, step_ms: int, down: list[float]) -> NetworkTrace:
    return NetworkTrace(
        name,
        tuple(range(0, step_ms * len(down), step_ms)),
        tuple(LinkSetting(rate, 10_000) for rate in down),
        step_ms * len(down),
    )


def greeted(receiver: Receiver, server: socket.socket) -> tuple[str, int]:
    """Where the service reaches the receiver. Packets of earlier tests may come first, or fill the queue."""
    for _ in range(50):
        receiver.socket.sendto(b"hello", GATEWAY)
        server.settimeout(0.05)
        with suppress(TimeoutError):
            while True:
                data, (host, port) = server.recvfrom(2048)
                if data == b"hello":
                    return host, port
    raise AssertionError("no greeting crossed the link")


def delivered(link: ShaperProcess, played: NetworkTrace, rate_kbps: float) -> tuple[Receiver, float]:
    """Plays a trace to its end while the service sends at a rate; returns the arrivals, and the trace's start."""
    receiver = Receiver(link.lab)
    with receiver.socket, server_socket(link.lab) as server:
        peer = greeted(receiver, server)
        with receiver.collecting(), flood(link.lab, peer, server, rate_kbps, SIZE):
            time.sleep(0.1)  # the queue is full when the trace starts
            start = link.play(played)
            time.sleep(start + played.duration_ms / 1e3 - time.monotonic())
    assert link.status().closed is None
    return receiver, start


def round_trips_ms(link: ShaperProcess, count: int) -> list[float]:
    """How long datagrams take to the service and back, one after the other, so that none waits for another."""
    times = []
    with echo_server(link.lab), udp(link.lab, "client") as client:
        client.settimeout(2)
        for _ in range(count):
            before = time.monotonic()
            client.sendto(b"ping", GATEWAY)
            client.recv(16)
            times.append((time.monotonic() - before) * 1e3)
    return times


@pytest.mark.parametrize(
    ("step_ms", "down"),
    [
        (1000, [20_000.0, 8_000.0, 32_000.0, 14_000.0, 25_000.0]),
        (100, [20_000.0 + 12_000.0 * math.sin(0.9 * step) for step in range(50)]),
    ],
)
@retried_on_a_busy_machine
def test_delivered_rate_follows_the_trace(link: ShaperProcess, step_ms: int, down: list[float]) -> None:
    receiver, start = delivered(link, trace(f"steps-{step_ms}", step_ms, down), PEAK)
    step = step_ms / 1e3
    errors = [
        abs(receiver.kbps(start + index * step, start + (index + 1) * step) - rate) / rate
        for index, rate in enumerate(down)
    ]
    print(f"mean absolute relative error at {step_ms} ms: {statistics.mean(errors):.2%}")
    assert statistics.mean(errors) < 0.05


@retried_on_a_busy_machine
def test_uplink_has_a_rate_of_its_own(link: ShaperProcess) -> None:
    link.post("/link", down_kbps=50_000, up_kbps=6_000)
    with udp(link.lab, "client") as client, server_socket(link.lab) as server:
        arrived = 0
        with flood(link.lab, GATEWAY, client, 12_000, SIZE):
            server.recvfrom(2048)
            end = time.monotonic() + 1.5
            while time.monotonic() < end:
                arrived += len(server.recvfrom(2048)[0]) + LAYER_2
    assert arrived * 8e-3 / 1.5 == pytest.approx(6_000, rel=0.05)


@retried_on_a_busy_machine
def test_an_outage_stops_everything_and_recovers_at_once(link: ShaperProcess) -> None:
    receiver, start = delivered(link, trace("outage", 1000, [20_000.0, 0.0, 0.0, 20_000.0]), 30_000)
    during = [at for at, _ in receiver.arrivals if start + 1.01 < at < start + 2.995]
    assert during == []
    back = min(at for at, _ in receiver.arrivals if at > start + 2.99) - start - 3
    print(f"recovered after {back * 1e3:.1f} ms")
    assert back < 0.3
    assert receiver.kbps(start + 3.3, start + 4) == pytest.approx(20_000, rel=0.05)


@pytest.mark.parametrize("rtt_ms", [20, 50, 100, 300])
@retried_on_a_busy_machine
def test_round_trip_takes_twice_the_delay(link: ShaperProcess, rtt_ms: int) -> None:
    """A busy machine makes packets later, but not all of them."""
    link.post("/link", down_kbps=50_000, up_kbps=20_000, delay_ms=rtt_ms / 2)
    times = round_trips_ms(link, max(4, 400 // rtt_ms))
    print(f"RTT {rtt_ms} ms: median {statistics.median(times):.2f}, {min(times):.2f} to {max(times):.2f}")
    assert rtt_ms - 0.5 < min(times) < rtt_ms + 3, "without jitter nothing is early"


@retried_on_a_busy_machine
def test_jitter_varies_the_delay(link: ShaperProcess) -> None:
    """A busy machine only makes packets later: jitter alone makes them earlier than the delay."""
    link.post("/link", down_kbps=50_000, up_kbps=20_000, delay_ms=20, jitter_ms=10)
    times = round_trips_ms(link, 80)
    first, median, third = statistics.quantiles(times)
    print(f"from {min(times):.1f} ms; quartiles {first:.1f}, {median:.1f}, {third:.1f} ms")
    assert min(times) > 2 * (20 - 10)
    assert first < 39
    assert median == pytest.approx(40, abs=6)
    assert third > 43


@retried_on_a_busy_machine
def test_jitter_keeps_the_order(link: ShaperProcess) -> None:
    link.post("/link", down_kbps=50_000, up_kbps=20_000, delay_ms=20, jitter_ms=10)
    with echo_server(link.lab), udp(link.lab, "client") as client:
        client.settimeout(2)
        for number in range(100):
            client.sendto(number.to_bytes(4, "big"), GATEWAY)
            time.sleep(0.002)  # far less than the jitter
        received = [int.from_bytes(client.recv(16), "big") for _ in range(100)]
    assert received == list(range(100))


@retried_on_a_busy_machine
def test_loss_is_within_its_confidence_interval(link: ShaperProcess) -> None:
    loss, count = 0.05, 3000
    link.post("/link", down_kbps=100_000, up_kbps=100_000, loss_pct=loss * 100)
    receiver = Receiver(link.lab)
    with receiver.socket, server_socket(link.lab) as server:
        for _ in range(20):  # a greeting may be lost as well
            peer = greeted(receiver, server)
        with receiver.collecting():
            for _ in range(count // 10):
                for _ in range(10):
                    server.sendto(bytes(100), peer)
                time.sleep(0.001)

            def ended() -> bool:  # packets keep their order, so the last one sent is the last to arrive
                server.sendto(b"end", peer)
                return receiver.count(len(b"end")) > 0

            wait_until(ended)
    lost = 1 - receiver.count(100) / count
    print(f"lost {lost:.2%}")
    assert lost == pytest.approx(loss, abs=3.3 * math.sqrt(loss * (1 - loss) / count))  # 99.9 %


@retried_on_a_busy_machine
def test_a_client_that_floods_fills_its_own_direction_only(link: ShaperProcess) -> None:
    link.post("/link", down_kbps=12_000, up_kbps=5_000)
    receiver = Receiver(link.lab)
    with receiver.socket, server_socket(link.lab) as server, udp(link.lab, "client") as flooder:
        peer = greeted(receiver, server)
        with flood(link.lab, GATEWAY, flooder, 30_000, SIZE), receiver.collecting():
            with flood(link.lab, peer, server, 15_000, SIZE):
                time.sleep(0.5)
                start = time.monotonic()
                time.sleep(1.0)
            status = link.status()
    assert receiver.kbps(start, start + 1) == pytest.approx(12_000, rel=0.05)
    assert status.up.drops > 0
    assert status.up.queue_ms < 160


@retried_on_a_busy_machine
def test_a_sender_may_keep_its_segmentation_offload(link: ShaperProcess) -> None:
    """As in a container that we cannot reach. A super-packet is cut before it is queued: as one, it would not fit into
    a short queue, or leave all at once."""
    argv = link.lab.command("service", ["ethtool", "-K", "service", "tx-udp-segmentation", "on", "gso", "on"])
    subprocess.run(argv, check=True, capture_output=True)
    link.post("/link", down_kbps=4_000, up_kbps=4_000)
    receiver = Receiver(link.lab)
    with receiver.socket, server_socket(link.lab) as server:
        peer = greeted(receiver, server)
        server.setsockopt(socket.SOL_UDP, UDP_SEGMENT, SIZE)
        with receiver.collecting():
            for _ in range(10):  # 5 Mbit/s
                server.sendto(bytes(40 * SIZE), peer)
                time.sleep(0.09)
    times = [at for at, _ in receiver.arrivals]
    gaps = [later - earlier for earlier, later in itertools.pairwise(times)]
    print(f"longest gap {max(gaps) * 1e3:.0f} ms, {receiver.kbps(times[0], times[-1]):.0f} kbit/s")
    assert max(gaps) < 0.05
    assert receiver.kbps(times[0], times[-1]) == pytest.approx(4_000, rel=0.1)
