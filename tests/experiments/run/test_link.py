"""A run's link: held, watched, and aborted on interference."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import httpx
import pytest

from tests.eventually import eventually
from tests.experiments.made_up import SERVER
from tests.web.fake_shaper import FakeShaper
from tigas_common.wire.shaper import DirectionStatus, LinkSetting, ShaperStatus
from tigas_experiments.errors import RunFailed
from tigas_experiments.run.link import OPENING_S, RunLink, ShaperClient, record_link, reserve_link
from tigas_experiments.run.parsing import parse_network
from tigas_experiments.run.targets import Target
from tigas_experiments.wire.run import Network

DURATION_MS = 30_000
LINK = LinkSetting(down_kbps=5000, up_kbps=1000, delay_ms=25)


def status(at_ms: float, position_ms: float | None = None, **changes: Any) -> ShaperStatus:
    """At a time; without a position, of a link that is constant."""
    lane = DirectionStatus(target_kbps=5000, delivered_kbps=4000, queue_bytes=600, queue_ms=1, drops=0)
    trace = {} if position_ms is None else {"mode": "playing", "trace": "bus", "duration_ms": DURATION_MS}
    fields = {
        "mode": "constant",
        "trace": None,
        "duration_ms": None,
        "loop": True,
        "backend": "netem",
        "closed": None,
        **trace,
    }
    told = {"time_ms": at_ms, "position_ms": position_ms, "down": lane, "up": lane, "link": LINK}
    return ShaperStatus.model_validate({**fields, **told, **changes})


def played(begin_ms: float, **at: dict[str, Any]) -> list[ShaperStatus]:
    """A trace that is played for two seconds; with changes of the n-th status, `_n`."""
    told = [status(200.0 * n, (begin_ms + 200 * n) % DURATION_MS) for n in range(12)]
    return [each.model_copy(update=at.get(f"_{n}", {})) for n, each in enumerate(told)]


def left_alone(network: Network, seen: list[ShaperStatus]) -> bool:
    """Judged like in a run, with the first one as the reference."""
    return RunLink(ShaperClient("http://127.0.0.1:9", ""), network, 0, seen[0]).is_undisturbed(seen)


BUS = Network(trace="bus")


@pytest.mark.parametrize("begin_ms", [0.0, 12_000.0, DURATION_MS - 500.0], ids=["start", "middle", "over the end"])
def test_a_trace_that_plays_is_left_alone(begin_ms: float) -> None:
    assert left_alone(BUS, played(begin_ms))
    assert left_alone(BUS, played(begin_ms, _7={"link": replace(LINK, delay_ms=80.0)})), "the trace's own delay"


@pytest.mark.parametrize(
    ("network", "changes"),
    [
        (BUS, {"_7": {"trace": "train"}}),
        (BUS, {"_11": {"trace": None, "mode": "constant"}}),
        (BUS, {"_7": {"mode": "paused"}}),
        (BUS, {"_11": {"mode": "ended"}}),
        (BUS, {"_11": {"position_ms": 9000.0}}),
        (BUS, {"_11": {"position_ms": 0.0}}),
        (BUS.with_rtt(50), {"_7": {"link": replace(LINK, delay_ms=80.0)}}),
    ],
)
def test_a_trace_that_somebody_else_changed_is_noticed(network: Network, changes: dict[str, Any]) -> None:
    assert left_alone(network, played(12_000))
    assert not left_alone(network, played(12_000, **changes))


@pytest.mark.parametrize(
    "change",
    [
        {"link": replace(LINK, down_kbps=6000.0)},
        {"link": replace(LINK, delay_ms=26.0)},
        {"trace": "bus"},
    ],
)
@pytest.mark.parametrize("name", ["5mbit,1mbit-up,50ms-rtt", "unshaped"])
def test_a_constant_link_that_somebody_else_changed_is_noticed(name: str, change: dict[str, Any]) -> None:
    seen = [status(at) for at in (0, 200, 400)]
    assert left_alone(parse_network(name), seen)
    assert not left_alone(parse_network(name), [*seen, seen[-1].model_copy(update=change)])


@pytest.fixture(scope="module")
def shaper() -> Iterator[FakeShaper]:
    """Which only pretends to shape."""
    with FakeShaper() as made:
        yield made


def watched(shaper: FakeShaper, network: str, somebody: tuple[str, dict[str, Any]] | None) -> None:
    """A run's link from beginning to end, with an optional change by another client in between."""

    async def run() -> None:
        target = Target("http://127.0.0.1:9", SERVER.model_copy(update={"services": {"shaper": shaper.url}}))
        async with reserve_link(target, parse_network(network)) as link:
            assert link is not None
            await link.play()
            async with record_link(link) as seen:
                for request in (somebody, None):
                    known = len(seen)
                    await eventually(lambda known=known: len(seen) >= known + 2)  # type: ignore[misc]
                    if request is not None:
                        async with httpx.AsyncClient(base_url=shaper.url) as http:
                            assert (await http.post(request[0], json=request[1])).is_success

    asyncio.run(run())


@pytest.mark.parametrize("network", ["20mbit,20ms-rtt", "unshaped", "stairs", "stairs,50ms-rtt"])
def test_a_link_of_ones_own_is_left_alone_and_released(shaper: FakeShaper, network: str) -> None:
    watched(shaper, network, None)
    assert shaper.asked[-1] == ("/stop", {})


@pytest.mark.parametrize(("offset_s", "before"), [(0, 30 - 3), (20, 20 - 3)])
def test_a_trace_plays_while_the_viewer_opens_and_warms_up(shaper: FakeShaper, offset_s: int, before: int) -> None:
    """So that an outage, at any moment, does not keep a viewer from getting ready."""

    async def run() -> None:
        target = Target("http://127.0.0.1:9", SERVER.model_copy(update={"services": {"shaper": shaper.url}}))
        network = parse_network("stairs").model_copy(update={"offset_s": offset_s})
        async with reserve_link(target, network, warm_up_s=3) as link:
            assert link is not None
            await link.warm_up()
            await link.play()

    shaper.asked.clear()
    asyncio.run(run())
    begin, *seeks, stop = [(path, body.get("position_ms")) for path, body in shaper.asked]
    assert (begin[0], stop[0]) == ("/start", "/stop")
    assert seeks == [("/seek", 1000 * at) for at in (before - OPENING_S, before, offset_s)]


@pytest.mark.parametrize(
    ("network", "request_"),
    [
        ("20mbit,20ms-rtt", ("/link", {"down_kbps": 20_000, "up_kbps": 10_000, "delay_ms": 50})),
        ("unshaped", ("/start", {"trace": "tunnel"})),
        ("stairs", ("/start", {"trace": "tunnel"})),
        ("stairs,50ms-rtt", ("/start", {"trace": "stairs", "delay_ms": 80})),
        ("stairs", ("/pause", {})),
        ("stairs", ("/seek", {"position_ms": 9000})),
        ("stairs", ("/stop", {})),
    ],
)
def test_who_else_touches_the_link_spoils_the_run(
    shaper: FakeShaper, network: str, request_: tuple[str, dict[str, Any]]
) -> None:
    with pytest.raises(RunFailed, match=r"^The link was changed from outside during the run\.$"):
        watched(shaper, network, request_)
    assert shaper.asked[-1] == ("/stop", {}), "it is fast again all the same"


def test_a_shaper_that_ends_in_good_order_spoils_the_run_too() -> None:
    async def run(shaper: FakeShaper) -> None:
        target = Target("http://127.0.0.1:9", SERVER.model_copy(update={"services": {"shaper": shaper.url}}))
        async with reserve_link(target, parse_network("unshaped")) as link, record_link(link) as seen:
            await eventually(lambda: bool(seen))
            await asyncio.to_thread(shaper.stop)

    with FakeShaper() as shaper, pytest.raises(RunFailed, match="stopped reporting its link"):
        asyncio.run(run(shaper))
