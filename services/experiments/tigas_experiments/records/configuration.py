"""What one run is: everything that must be known to make it again."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from tigas_common.wire.model import MAX_SIDE, WireModel

Mode = Literal["stateless", "dash-typical", "dash-tuned"]
"""One JPEG per pose; DASH as live services ship it; DASH as low as it holds."""
MODES: tuple[Mode, ...] = ("stateless", "dash-typical", "dash-tuned")
MODE_NAMES: dict[Mode, str] = {
    "stateless": "Stateless",
    "dash-typical": "DASH, typical",
    "dash-tuned": "DASH, tuned",
}
UP_KBPS = 10_000.0
"""The uplink of a constant link that says nothing of it."""
UNSHAPED = "unshaped"
MAX_RTT_MS = 120_000.0
MAX_OFFSET_S = 86_400.0
MOST_PICTURES = 120
"""Of a run: they lie in the page's memory until it has ended."""
_PART = re.compile(r"(?P<value>\d+(?:\.\d+)?)(?P<unit>mbit-up|kbit-up|mbit|kbit|ms-rtt|ms-jitter|%-loss)")
_OVERRIDE = re.compile(r"(?P<trace>.+),(?P<rtt>\d+(?:\.\d+)?)ms-rtt")


class ConstantLink(WireModel):
    """A link that does not change; the same as the shaper's LinkSetting."""

    down_kbps: float = Field(ge=0)
    up_kbps: float = Field(default=UP_KBPS, ge=0)
    delay_ms: float = Field(default=0.0, ge=0)
    """One way, in each direction."""
    jitter_ms: float = Field(default=0.0, ge=0)
    loss_pct: float = Field(default=0.0, ge=0, le=100)


class Network(WireModel):
    """The network of a run: a constant link, a trace (of the shaper's, or from a file), or none of these."""

    name: str = Field(min_length=1, max_length=100)
    link: ConstantLink | None = None
    trace_file: Path | None = None
    """The trace's file, as a person named it; without it, the shaper knows the trace by its name."""
    rtt_ms: float | None = Field(default=None, ge=0, le=MAX_RTT_MS)
    """Of a trace: in place of its own delay and jitter. A constant link says its delay itself."""
    offset_s: float = Field(default=0.0, ge=0, le=MAX_OFFSET_S)
    """Of a trace: the position that a run begins at."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.rtt_ms is not None and (self.link is not None or not self.shaped):
            raise ValueError("only a trace's round trip can be replaced")
        if self.offset_s and not self.is_trace:
            raise ValueError("only a trace can begin at another position")
        return self

    @property
    def round_trip_ms(self) -> float | None:
        """That it adds, where it is constant and known before the run."""
        return self.rtt_ms if self.link is None else 2 * self.link.delay_ms

    @property
    def shaped(self) -> bool:
        """Whether it needs a shaper."""
        return self.name != UNSHAPED

    @property
    def is_trace(self) -> bool:
        """Whether a trace is played."""
        return self.shaped and self.link is None

    def with_rtt(self, rtt_ms: float) -> Network:
        """The same rates at another round trip. Raises ValueError."""
        if not self.shaped:
            raise ValueError("an unshaped network has the round trip that it has")
        if self.link is None:
            return self.model_copy(update={"rtt_ms": rtt_ms})
        others = [part for part in self.name.split(",") if not part.strip().endswith("ms-rtt")]
        link = self.link.model_copy(update={"delay_ms": rtt_ms / 2})
        return Network(name=",".join([*others, f"{rtt_ms:g}ms-rtt"]), link=link)

    @classmethod
    def parse(cls, text: str, directory: Path = Path()) -> Network:
        """Read what a person wrote: `20mbit,20ms-rtt`, `unshaped`, or a trace (file or name), or `TRACE,100ms-rtt`.

        A file's path is relative to `directory`, and kept as it was written. Raises ValueError with one sentence.
        """
        if text == UNSHAPED:
            return cls(name=UNSHAPED)
        if _PART.match(text):
            return cls(name=text, link=_constant(text))
        override = _OVERRIDE.fullmatch(text)
        trace, rtt_ms = (override["trace"], float(override["rtt"])) if override else (text, None)
        path = Path(trace)
        if (directory / path).is_file():
            return cls(name=path.name[:100], trace_file=path, rtt_ms=rtt_ms)
        if path.name != trace or path.suffix:
            raise ValueError(f"there is no trace file {trace!r}")
        return cls(name=trace, rtt_ms=rtt_ms)


class Configuration(WireModel):
    """One run. Two runs with equal configurations get the same inputs."""

    scene: str
    movement: str
    """A generated movement's name, or the movement trace's file, as a person named it."""
    network: Network
    mode: Mode
    duration_s: float = Field(ge=1, le=7200)
    width: int = Field(ge=64, le=MAX_SIDE)
    height: int = Field(ge=64, le=MAX_SIDE)
    """The viewport, in CSS pixels."""
    profile: int | str = "budget"
    """Of the mode `stateless`: the ladder's rung, or the name of a controller."""
    seed: int = Field(default=1, ge=0, le=2**53 - 1)
    """Of generated movements, and of the controllers' random numbers."""
    repeat: int = Field(default=0, ge=0)
    capture_every_ms: float = Field(default=1000.0, ge=0)
    """A shown frame is kept so often; 0 keeps none."""
    warm_up_s: float = Field(default=5.0, ge=0, le=600)
    """How long the viewer stands at the first pose, with frames on the screen, before the movement begins."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if isinstance(self.profile, int) and not 0 <= self.profile <= 255:
            raise ValueError("the profile is a rung of the ladder, counted from 0, or a controller's name")
        return self

    def asks_for_the_same(self, other: Configuration) -> bool:
        """Whether the two are equal but for the folders that files lie in."""
        return self._without_folders() == other._without_folders()

    def _without_folders(self) -> Configuration:
        network = self.network.model_copy(update={"trace_file": None})  # its name says which file it was
        return self.model_copy(update={"movement": Path(self.movement).name, "network": network})

    @property
    def slug(self) -> str:
        """A name for its folder."""
        mode = f"{self.mode}-{self.profile}" if self.mode == "stateless" else self.mode
        network = self.network.name
        if self.network.rtt_ms is not None:
            network = f"{network[:30]}-{self.network.rtt_ms:g}ms"
        parts = (self.scene, Path(self.movement).stem, network, mode, f"{self.repeat}")
        return "_".join(re.sub(r"[^A-Za-z0-9.-]+", "-", part).strip(".-")[:40] or "x" for part in parts)


def capture_interval_ms(every_s: float, duration_s: float) -> float:
    """How often a frame is kept, for one in so many seconds, but at most MOST_PICTURES a run; 0 keeps none."""
    return max(every_s, duration_s / MOST_PICTURES) * 1000 if every_s else 0.0


def parse_viewport(text: str) -> tuple[int, int]:
    """Width and height from `640x360`. Raises ValueError with one sentence."""
    width, _, height = text.partition("x")
    if not width.isdecimal() or not height.isdecimal():
        raise ValueError(f"{text!r} is not WIDTHxHEIGHT, such as 1280x720")
    return int(width), int(height)


def _constant(text: str) -> ConstantLink:
    fields: dict[str, float] = {}
    for part in text.split(","):
        found = _PART.fullmatch(part.strip())
        if found is None:
            raise ValueError(
                f"{part.strip()!r} is no part of a link, such as 20mbit, 5mbit-up, 20ms-rtt, 2ms-jitter or 0.1%-loss"
            )
        name, factor = _UNITS[found["unit"]]
        if name in fields:
            raise ValueError(f"{text!r} says {found['unit']} twice")
        fields[name] = float(found["value"]) * factor
    if "down_kbps" not in fields:
        raise ValueError(f"{text!r} says no rate, such as 20mbit")
    return ConstantLink(**fields)


_UNITS = {
    "mbit": ("down_kbps", 1000.0),
    "kbit": ("down_kbps", 1.0),
    "mbit-up": ("up_kbps", 1000.0),
    "kbit-up": ("up_kbps", 1.0),
    "ms-rtt": ("delay_ms", 0.5),
    "ms-jitter": ("jitter_ms", 1.0),
    "%-loss": ("loss_pct", 1.0),
}
