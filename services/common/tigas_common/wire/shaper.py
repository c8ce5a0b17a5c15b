"""Messages between the shaper and the clients of its link."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from tigas_common.wire.model import Entries, WireModel

MAX_RATE_KBPS = 1e8
MAX_DELAY_MS = 60_000.0
MAX_DURATION_MS = 30 * 24 * 3600 * 1000
"""Of a trace."""

MAX_UPLOAD_BYTES = 16_000_000
"""Of a trace's file."""
TRACE_SUFFIXES = frozenset({".gz", ".csv", ".json", ".txt", ".log"})
"""Of trace files; a trace's name has none of them."""

PlaybackMode = Literal["constant", "playing", "paused", "ended"]
"""Playback of a trace; `constant` has none."""
Backend = Literal["netem", "relay"]
"""Implementation of delay, jitter and loss: the kernel's netem, or our own relay."""


_Number = Annotated[float, Field(ge=0, strict=True, allow_inf_nan=False)]
Rate = Annotated[_Number, Field(le=MAX_RATE_KBPS)]
Delay = Annotated[_Number, Field(le=MAX_DELAY_MS)]
Percent = Annotated[_Number, Field(le=100)]


# A model would be ten times as large, and a trace may have a quarter of a million of them.
@dataclass(frozen=True, slots=True, config=ConfigDict(extra="forbid"))
class LinkSetting:
    """Effects of a link on packets."""

    down_kbps: Rate
    """Towards the client, kbit/s of whole Ethernet frames. 0 is an outage: packets wait."""
    up_kbps: Rate
    """From the client, likewise."""
    delay_ms: Delay = 0.0
    """One way, added in each direction: a round trip takes twice as long."""
    jitter_ms: Delay = 0.0
    """Variation of the delay, in each direction."""
    loss_pct: Percent = 0.0
    """Packets lost at random in each direction, per cent."""


class StartRequest(WireModel):
    """Play a trace from its start."""

    trace: str = Field(max_length=100)
    loop: bool = True
    delay_ms: Delay | None = None
    """One way, in each direction, in place of the trace's own delay and jitter; null keeps these."""


class SeekRequest(WireModel):
    """Go to a position in the trace."""

    position_ms: float = Field(ge=0, le=MAX_DURATION_MS)


class LoopRequest(WireModel):
    """Whether to start again at the end."""

    loop: bool


class TraceSummary(WireModel):
    """A trace in the list. If `error` is not null, the trace cannot be played and the other fields are zero."""

    name: str
    uploaded: bool
    """Kept in memory until the shaper stops, rather than in its directory."""
    duration_ms: int = 0
    steps: int = 0
    mean_down_kbps: float = 0.0
    min_down_kbps: float = 0.0
    max_down_kbps: float = 0.0
    mean_up_kbps: float = 0.0
    outages: int = 0
    """Number of outages towards the client."""
    error: str | None = None


class TraceList(WireModel):
    """Every trace that there is."""

    traces: Entries[TraceSummary]


class TracePoints(WireModel):
    """A trace's outline, as means over spans of time."""

    name: str
    duration_ms: int
    times_ms: Entries[float]
    """Where each span starts; the last one ends at the end of the trace."""
    down_kbps: Entries[float]
    up_kbps: Entries[float]


class DirectionStatus(WireModel):
    """One direction, as tc counts it: bytes of whole Ethernet frames."""

    target_kbps: float
    delivered_kbps: float
    """Since the sample before."""
    queue_bytes: int
    queue_ms: float
    """How long the queue takes to drain at the target rate; in an outage, at the last one before."""
    drops: int
    """Packets lost because the queue was full, since the shaper was started."""


class ShaperStatus(WireModel):
    """The link at one moment, and its playback."""

    time_ms: float
    """Of the shaper's own steady clock."""
    mode: PlaybackMode
    trace: str | None
    position_ms: float | None
    duration_ms: int | None
    loop: bool
    link: LinkSetting
    down: DirectionStatus
    up: DirectionStatus
    backend: Backend
    closed: str | None
    """Reason why the link is closed, in one sentence; null while it works."""
