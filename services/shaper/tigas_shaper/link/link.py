"""The shaped link: two directions, each held to a rate, a queue, a delay, jitter and loss. In each direction:

    forwarded packets, marked by nftables
      → clsact egress of the interface towards their receiver: redirected to the rate device
      → HTB on the rate device, with a leaf queue counted in bytes
      → delay, jitter and loss (delay.py)
      → the interface, and out

Only marked packets take this path: packets of the gateway itself, such as answers of its API, are not shaped. The leaf
is a token bucket far faster than the link. It queues bytes in first-in-first-out order like bfifo, and also splits
segmentation-offload super-packets (up to 64 kB, one unit to a queue) into packets on arrival, so that offloads may stay
enabled on senders out of our reach.
"""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass
from typing import Any

from tigas_common.errors import TigasError
from tigas_common.wire.shaper import Backend, LinkSetting
from tigas_shaper.link.commands import MATCH_MARKED, Channel, CommandError, Interface, try_run
from tigas_shaper.link.delay import STAGES, DelayStage

DOWN_DEVICE = Interface("tigas-down")
UP_DEVICE = Interface("tigas-up")
TC = ("tc", "-force", "-s", "-j", "-batch", "-")
FLOOR_KBPS = 50.0
"""Minimum rate. HTB waits for a packet's transmission time before it sends the next, even if the rate has risen since:
a quarter of a second at this rate. In an outage, HTB keeps its rate and the leaf is slowed to this one instead, since a
token bucket loses its debt when changed, so that traffic resumes at once. The delay stage stops the remaining trickle.
"""
FULL_PACKET = 1514
"""Size of a full Ethernet packet, as tc counts it."""
MIN_QUEUE = 8 * FULL_PACKET
"""Minimum size of a queue in bytes, as a slow link must still accept a burst of a few packets."""
MAX_QUEUE = 2**32 - 1
"""Maximum size of a queue in bytes, a limit of tc."""
LEAF_KBPS = 1e7
LEAF_BURST = 2 * FULL_PACKET
"""Bytes; the leaf drops longer packets."""
MAX_MTU = 3000
"""Maximum MTU of the interfaces: less than the burst by the size of link-layer headers."""


class LinkClosed(TigasError):
    status, type, title = 503, "link-closed", "The link is closed"


class ShapedLink:
    """A link in the kernel. Once closed, it stays closed."""

    def __init__(self, down: Direction, up: Direction, backend: Backend, on_close: Callable[[], None]) -> None:
        self.backend = backend
        self.closed_reason: str | None = None
        """Reason why the link is closed, in one sentence."""
        self._down = down
        self._up = up
        self._on_close = on_close

    @classmethod
    @asynccontextmanager
    async def open(
        cls,
        access: Interface,
        service: Interface,
        state: LinkSetting,
        *,
        backend: Backend,
        queue_ms: float,
        on_close: Callable[[], None],
    ) -> AsyncIterator[ShapedLink]:
        """Shape packets forwarded between two interfaces, as a context manager.

        `on_close` is called if the link closes earlier. Raises CommandError if it cannot be set up.
        """
        async with AsyncExitStack() as stack:
            tc = await stack.enter_async_context(Channel.open(TC, "Command failed"))
            down, up = [
                await stack.enter_async_context(
                    Direction.open(tc, device, interface, backend=backend, queue_ms=queue_ms)
                )
                for device, interface in ((DOWN_DEVICE, access), (UP_DEVICE, service))
            ]
            link = cls(down, up, backend, on_close)
            link.apply(state, (state.down_kbps, state.up_kbps))
            await link.counters()
            yield link

    def apply(self, state: LinkSetting, mean_kbps: tuple[float, float] | None = None) -> None:
        """Change the link now; `mean_kbps`, down and up, sizes its queues. Raises LinkClosed."""
        mean_down, mean_up = mean_kbps or (None, None)
        with self._close_on_error():
            self._down.shape(state, state.down_kbps, mean_down)
            self._up.shape(state, state.up_kbps, mean_up)

    async def counters(self) -> tuple[Counters, Counters]:
        """Counters of both directions, down first. Raises LinkClosed, also for errors since the last call."""
        with self._close_on_error():
            return await self._down.counters(), await self._up.counters()

    def close(self, reason: str) -> None:
        if self.closed_reason is None:
            self.closed_reason = reason
            self._on_close()

    @contextmanager
    def _close_on_error(self) -> Iterator[None]:
        """Close the link on a CommandError. Raises LinkClosed, also if it is already closed."""
        if self.closed_reason is not None:
            raise LinkClosed(self.closed_reason)
        try:
            yield
        except CommandError as error:
            reason = f"Shaping failed; nothing passes until the shaper is restarted: {error}"
            self.close(reason)
            raise LinkClosed(reason) from None


@dataclass(frozen=True, slots=True)
class Counters:
    """tc's counters for one direction. Bytes include Ethernet headers."""

    sent_bytes: int
    dropped_packets: int
    """Packets lost because the queue was full."""
    queue_bytes: int


class Direction:
    """Current settings of one direction, of which only changes are sent to tc. Methods raise CommandError."""

    def __init__(
        self, tc: Channel, device: Interface, interface: Interface, stage: DelayStage, *, queue_ms: float
    ) -> None:
        self._tc = tc
        self._device = device
        self._interface = interface
        self._number = interface.number
        self._stage = stage
        self._queue_ms = queue_ms
        self._limit = MIN_QUEUE
        self._rate: float | None = None
        self._blocked = False
        self._delay: tuple[float, float, float, bool] | None = None

    @classmethod
    @asynccontextmanager
    async def open(
        cls, tc: Channel, device: Interface, interface: Interface, *, backend: Backend, queue_ms: float
    ) -> AsyncIterator[Direction]:
        """Shape an interface's outgoing packets through a new rate device, as a context manager."""
        async with STAGES[backend].open(tc, device, interface) as stage:
            try:
                tc.write(
                    f"qdisc add dev {device} root handle 1: htb default 1",
                    rate_line("add", device, FLOOR_KBPS),
                    queue_line("add", device, MIN_QUEUE, LEAF_KBPS),
                    f"qdisc add dev {interface} clsact",
                    f"filter add dev {interface} egress protocol ip prio 1 {MATCH_MARKED} "
                    f"action mirred egress redirect dev {device}",
                )
                await tc.ask(f"qdisc show dev {device}", "[")
                yield cls(tc, device, interface, stage, queue_ms=queue_ms)
            finally:
                await try_run("tc", "qdisc", "del", "dev", interface, "clsact")

    def shape(self, state: LinkSetting, rate_kbps: float, mean_kbps: float | None) -> None:
        """Apply a rate, and the state's delay, jitter and loss; the queue is sized for the mean rate if given."""
        lines = []
        blocked = rate_kbps == 0
        if not blocked and rate_kbps != self._rate:
            lines.append(rate_line("change", self._device, rate_kbps))
            self._rate = rate_kbps
        limit = self._limit if mean_kbps is None else queue_bytes(mean_kbps, self._queue_ms)
        if (limit, blocked) != (self._limit, self._blocked):
            lines.append(queue_line("change", self._device, limit, FLOOR_KBPS if blocked else LEAF_KBPS))
            self._limit, self._blocked = limit, blocked
        delay = (state.delay_ms, state.jitter_ms, state.loss_pct, blocked)
        if delay != self._delay:
            self._stage.set(state, blocked=blocked)
            self._delay = delay
        self._tc.write(*lines)

    async def counters(self) -> Counters:
        """tc's counters. Also reports errors since the last call."""
        if self._interface.number != self._number:
            raise CommandError(f"the interface {self._interface} has disappeared.")
        await self._stage.check()
        answer: list[dict[str, Any]] = json.loads(await self._tc.ask(f"qdisc show dev {self._device}", "["))
        root = next((entry for entry in answer if entry.get("root") and entry["kind"] == "htb"), None)
        if root is None:
            raise CommandError(f"another program has removed the shaping of {self._device}.")
        if not json.loads(await self._tc.ask(f"filter show dev {self._interface} egress", "[")):
            raise CommandError(f"another program has removed the shaping of {self._interface}.")
        return Counters(root["bytes"], root["drops"], root["backlog"])


def queue_bytes(rate_kbps: float, queue_ms: float) -> int:
    """Size of a queue that takes `queue_ms` to drain at this rate."""
    return min(MAX_QUEUE, max(MIN_QUEUE, round(rate_kbps * queue_ms / 8)))


def rate_line(verb: str, device: Interface, rate_kbps: float) -> str:
    """Add the rate device's class, or change its rate; queued packets are kept."""
    rate = max(rate_kbps, FLOOR_KBPS)
    # The burst lets a late timer catch up, by at most a millisecond of the rate.
    burst = max(2 * FULL_PACKET, round(rate / 8))
    return (
        f"class {verb} dev {device} parent 1: classid 1:1 htb "
        f"rate {round(rate * 1000)}bit burst {burst}b cburst {burst}b quantum {2 * FULL_PACKET}"
    )


def queue_line(verb: str, device: Interface, limit_bytes: int, rate_kbps: float) -> str:
    """Add the queue, or change its size and the rate at which packets leave it."""
    return (
        f"qdisc {verb} dev {device} parent 1:1 handle 10: "
        f"tbf rate {round(rate_kbps)}kbit burst {LEAF_BURST}b limit {limit_bytes}b"
    )
