"""The shaped link: two directions, each held to a rate, a queue, a delay, jitter and loss."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import Any, Protocol

from tigas_common.wire.shaper import Backend, LinkSetting
from tigas_shaper.errors import LinkClosed
from tigas_shaper.link.channel import Channel, CommandError, attempt
from tigas_shaper.link.delay import STAGES, DelayStage
from tigas_shaper.link.direction import FLOOR_KBPS, MIN_QUEUE, Direction, queue_bytes
from tigas_shaper.link.interfaces import Interface

DOWN_DEVICE = Interface("tigas-down")
UP_DEVICE = Interface("tigas-up")
TC = ("tc", "-force", "-s", "-j", "-batch", "-")


@dataclass(frozen=True, slots=True)
class Counters:
    """What tc has counted in one direction. Bytes are those of whole Ethernet frames."""

    sent_bytes: int
    sent_packets: int
    dropped_packets: int
    """Lost because the queue was full."""
    queue_bytes: int
    queue_packets: int


class Link(Protocol):
    """What a player plays on. Both methods raise LinkClosed."""

    def apply(self, state: LinkSetting) -> None:
        """Change the link, now."""

    def size_queues(self, down_kbps: float, up_kbps: float) -> None:
        """Fit the queues to the mean rates of what is going to be played."""


class ShapedLink:
    """A link in the kernel. Once closed it stays closed."""

    def __init__(self, down: _Lane, up: _Lane, backend: Backend, on_close: Callable[[], None]) -> None:
        self.backend = backend
        self.closed: str | None = None
        """Why the link is closed, in one sentence."""
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
        """Shape what is forwarded between two interfaces for as long as the context lasts.

        `on_close` is called when the link closes before that. Raises CommandError if it cannot be set up.
        """
        async with AsyncExitStack() as stack:
            tc = await stack.enter_async_context(Channel.open(TC, "Command failed"))

            async def lane(device: Interface, interface: Interface) -> _Lane:
                direction = Direction(device, interface)
                stage = await stack.enter_async_context(STAGES[backend].open(tc, direction))
                stack.push_async_callback(attempt, "tc", "qdisc", "del", "dev", interface, "clsact")
                tc.write(*direction.rate_lines(FLOOR_KBPS), *direction.redirect_lines())
                await tc.ask(f"qdisc show dev {device}", "[")
                return _Lane(tc, direction, stage, queue_ms)

            link = cls(await lane(DOWN_DEVICE, access), await lane(UP_DEVICE, service), backend, on_close)
            link.size_queues(state.down_kbps, state.up_kbps)
            link.apply(state)
            await link.counters()
            yield link

    def apply(self, state: LinkSetting) -> None:
        with _Closing(self):
            self._down.apply(state, state.down_kbps)
            self._up.apply(state, state.up_kbps)

    def size_queues(self, down_kbps: float, up_kbps: float) -> None:
        with _Closing(self):
            self._down.size_queue(down_kbps)
            self._up.size_queue(up_kbps)

    async def counters(self) -> tuple[Counters, Counters]:
        """Of both directions, down first. Finds whatever went wrong since: raises LinkClosed."""
        with _Closing(self):
            return await self._down.counters(), await self._up.counters()

    def close(self, reason: str) -> None:
        """Let nothing pass any more."""
        if self.closed is None:
            self.closed = reason
            self._on_close()


class _Closing:
    """Closes the link on a CommandError, and refuses to use a closed one."""

    def __init__(self, link: ShapedLink) -> None:
        self._link = link

    def __enter__(self) -> None:
        if self._link.closed is not None:
            raise LinkClosed(self._link.closed)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: object) -> None:
        if isinstance(error, CommandError):
            reason = f"Shaping failed, so that nothing passes until the shaper is started again: {error}"
            self._link.close(reason)
            raise LinkClosed(reason) from None


class _Lane:
    """One direction with what is in force there: only what changes is sent to tc."""

    def __init__(self, tc: Channel, direction: Direction, stage: DelayStage, queue_ms: float) -> None:
        self._tc = tc
        self._direction = direction
        self._number = direction.interface.number
        self._stage = stage
        self._queue_ms = queue_ms
        self._limit = MIN_QUEUE
        self._rate: float | None = None
        self._blocked = False
        self._delay: tuple[float, float, float, bool] | None = None

    def size_queue(self, rate_kbps: float) -> None:
        self._limit = queue_bytes(rate_kbps, self._queue_ms)
        self._tc.write(self._direction.change_queue_line(self._limit, blocked=self._blocked))

    def apply(self, state: LinkSetting, rate_kbps: float) -> None:
        blocked = rate_kbps == 0
        if not blocked and rate_kbps != self._rate:
            self._tc.write(self._direction.change_rate_line(rate_kbps))
            self._rate = rate_kbps
        delay = (state.delay_ms, state.jitter_ms, state.loss_pct, blocked)
        if delay != self._delay:
            self._stage.set(state, blocked=blocked)
            self._delay = delay
        if blocked != self._blocked:
            self._blocked = blocked
            self._tc.write(self._direction.change_queue_line(self._limit, blocked=blocked))

    async def counters(self) -> Counters:
        if self._direction.interface.number != self._number:
            raise CommandError(f"the interface {self._direction.interface} has disappeared.")
        self._stage.check()
        answer: list[dict[str, Any]] = json.loads(await self._tc.ask(f"qdisc show dev {self._direction.device}", "["))
        root = next((entry for entry in answer if entry.get("root") and entry["kind"] == "htb"), None)
        if root is None:
            raise CommandError(f"somebody else has removed the shaping of {self._direction.device}.")
        return Counters(root["bytes"], root["packets"], root["drops"], root["backlog"], root["qlen"])
