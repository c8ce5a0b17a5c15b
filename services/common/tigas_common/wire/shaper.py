"""Messages between the shaper and the clients of its link."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from tigas_common.wire.model import Entries, WireModel

MAX_RATE_KBPS = 1e8
MAX_DELAY_MS = 60_000.0
MAX_DURATION_MS = 30 * 24 * 3600 * 1000
"""Maximum duration of a trace."""

MAX_UPLOAD_BYTES = 16_000_000
"""Maximum size of a trace file."""
TRACE_SUFFIXES = frozenset({".gz", ".csv", ".json", ".txt", ".log"})
"""Suffixes of trace files, which are not part of a trace's name."""

PlaybackMode = Literal["constant", "playing", "paused", "ended"]
"""Playback state; `constant` means that no trace is selected."""
Backend = Literal["netem", "relay"]
"""Implementation of delay, jitter and loss: the kernel's netem, or our own relay."""


_Number = Annotated[float, Field(ge=0, strict=True, allow_inf_nan=False)]
Rate = Annotated[_Number, Field(le=MAX_RATE_KBPS)]
Delay = Annotated[_Number, Field(le=MAX_DELAY_MS)]
Percent = Annotated[_Number, Field(le=100)]


# A dataclass, as a model would be ten times as large and a trace may have 250,000 settings.
@dataclass(frozen=True, slots=True, config=ConfigDict(extra="forbid"))
class LinkSetting:
    """Effects of a link on packets."""

    down_kbps: Rate
    """Rate towards the client, in kbit/s of whole Ethernet frames. 0 is an outage: packets wait."""
    up_kbps: Rate
    """Rate from the client, likewise."""
    delay_ms: Delay = 0.0
    """One-way delay added in each direction; a round trip takes twice as long."""
    jitter_ms: Delay = 0.0
    """Variation of the delay in each direction."""
    loss_pct: Percent = 0.0
    """Share of packets lost at random in each direction, in per cent."""


class StartRequest(WireModel):
    """Play a trace from its start."""

    trace: str = Field(max_length=100)
    loop: bool = True
    delay_ms: Delay | None = None
    """One-way delay in each direction, in place of the trace's delay and jitter; null keeps them."""


class SeekRequest(WireModel):
    """Go to a position in the trace."""

    position_ms: float = Field(ge=0, le=MAX_DURATION_MS)


class LoopRequest(WireModel):
    """Whether to start over at the end."""

    loop: bool


class TraceSummary(WireModel):
    """A trace in the list. If `error` is not null, the trace cannot be played and the other fields are zero."""

    name: str
    uploaded: bool
    """Whether the trace was uploaded: it is kept in memory until the shaper stops, rather than in its directory."""
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
    """All available traces."""

    traces: Entries[TraceSummary]


class TracePoints(WireModel):
    """A trace's outline, as means over intervals."""

    name: str
    duration_ms: int
    times_ms: Entries[float]
    """Start of each interval; the last one ends at the end of the trace."""
    down_kbps: Entries[float]
    up_kbps: Entries[float]


class DirectionStatus(WireModel):
    """One direction, in tc's counting: bytes of whole Ethernet frames."""

    target_kbps: float
    delivered_kbps: float
    """Mean rate since the previous sample."""
    queue_bytes: int
    queue_ms: float
    """Time that the queue takes to drain at the target rate; during an outage, at the last rate before it."""
    drops: int
    """Packets lost because the queue was full, since the shaper started."""


class ShaperStatus(WireModel):
    """The link and its playback at one moment."""

    time_ms: float
    """Time of the shaper's own steady clock."""
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
