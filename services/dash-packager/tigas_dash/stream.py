"""One viewer's stream, however it travels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass
from typing import ClassVar, Literal

from tigas_common.wire.dash import SessionStatus, StreamRequest
from tigas_dash.clock import Clock
from tigas_dash.encoder import RawFrame
from tigas_dash.source import ViewSource
from tigas_dash.views import NewestView

Transport = Literal["dash", "webrtc"]


@dataclass(slots=True)
class Progress:
    frames: int = 0
    repeated: int = 0
    """Frames that repeat the last view because no newer one arrived in time."""
    dropped: int = 0
    """Frames that were left out, as the stream was late."""


class Stream(ABC):
    """A running stream. `Sessions` runs it."""

    transport: ClassVar[Transport]

    def __init__(
        self,
        name: str,
        request: StreamRequest,
        rungs: tuple[int, ...],
        source: ViewSource,
        first: RawFrame,
        clock: Clock,
    ) -> None:
        self.name = name
        self.rungs = rungs
        """One for each representation."""
        self.progress = Progress()
        self.sent_bytes: Counter[int] = Counter()
        """Bytes of segments or datagrams, by rung."""
        self.used_at = clock.now()
        """Time of the viewer's last request or packet, on the steady clock."""
        self._request = request
        self._clock = clock
        self._started_at = clock.now()
        self._views = NewestView(name, source, first, clock)
        self._poses = 0

    @abstractmethod
    async def run(self) -> None:
        """Stream until cancelled, or until the stream cannot go on."""

    @property
    @abstractmethod
    def behind_s(self) -> float:
        """For how long the next frame has been due, in seconds."""

    @property
    @abstractmethod
    def watchers(self) -> int:
        """Connections of viewers."""

    @property
    def watched(self) -> bool:
        """Whether it is certainly being watched, however long ago it was used."""
        return False

    @property
    def encoder_failures(self) -> int:
        """Frames that an encoder refused."""
        return 0

    @property
    def status(self) -> SessionStatus:
        return SessionStatus(
            id=self.name,
            scene=self._request.scene,
            age_s=self._clock.now() - self._started_at,
            frames=self.progress.frames,
            repeated=self.progress.repeated,
            dropped=self.progress.dropped,
            poses=self._poses,
            render_failures=self._views.failures,
            render_problem=self._views.problem,
            encoder_failures=self.encoder_failures,
            watchers=self.watchers,
        )
