"""The shaped link: two directions, each held to a rate, a queue, a delay, jitter and loss."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager

from tigas_common.wire.shaper import Backend, LinkSetting
from tigas_shaper.errors import LinkClosed
from tigas_shaper.link.channel import Channel, CommandError
from tigas_shaper.link.direction import Counters, Direction
from tigas_shaper.link.interfaces import Interface

DOWN_DEVICE = Interface("tigas-down")
UP_DEVICE = Interface("tigas-up")
TC = ("tc", "-force", "-s", "-j", "-batch", "-")


class ShapedLink:
    """A link in the kernel. Once closed it stays closed."""

    def __init__(self, down: Direction, up: Direction, backend: Backend, on_close: Callable[[], None]) -> None:
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
        """Shape packets forwarded between two interfaces, as a context manager.

        `on_close` is called when the link closes before that. Raises CommandError if it cannot be set up.
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
        """Change the link, now; `mean_kbps`, down and up, sizes its queues. Raises LinkClosed."""
        mean_down, mean_up = mean_kbps or (None, None)
        with _Closing(self):
            self._down.shape(state, state.down_kbps, mean_down)
            self._up.shape(state, state.up_kbps, mean_up)

    async def counters(self) -> tuple[Counters, Counters]:
        """Counters of both directions, down first. Reports errors since the last call: raises LinkClosed."""
        with _Closing(self):
            return await self._down.counters(), await self._up.counters()

    def close(self, reason: str) -> None:
        """Close the link for good."""
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
