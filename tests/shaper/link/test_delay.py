"""Commands to netem. (The relay has its own tests, and both are tested in the namespaces.)"""

from __future__ import annotations

from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.link.delay import NetemStage
from tigas_shaper.link.interfaces import Interface


class Tc:
    """Records its commands."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def write(self, *lines: str) -> None:
        self.lines += lines


def test_netem_gets_microseconds_keeps_the_order_and_loses_everything_in_an_outage() -> None:
    tc = Tc()
    stage = NetemStage(tc, Interface("eth0"))  # type: ignore[arg-type]
    state = LinkSetting(1, 1, delay_ms=12.5, jitter_ms=0.25, loss_pct=1.5)
    stage.set(state, blocked=False)
    stage.set(state, blocked=True)
    told = "qdisc change dev eth0 parent 2:1 handle 20: netem limit 100000 delay 12500us 250us loss {}% rate 100gbit"
    assert tc.lines == [told.format("1.5000"), told.format("100.0000")]
