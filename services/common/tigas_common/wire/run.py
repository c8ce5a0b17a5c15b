"""What one run is: everything that must be known to make it again."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from tigas_common.wire.model import MAX_SIDE, WireModel
from tigas_common.wire.shaper import LinkSetting

Mode = Literal["stateless", "dash-typical", "dash-tuned"]
"""One JPEG per pose; DASH as live services ship it; DASH as low as it holds."""
MODES: tuple[Mode, ...] = ("stateless", "dash-typical", "dash-tuned")
MODE_NAMES: dict[Mode, str] = {
    "stateless": "Stateless",
    "dash-typical": "DASH, typical",
    "dash-tuned": "DASH, tuned",
}
UNSHAPED = "unshaped"
MAX_RTT_MS = 120_000.0
MAX_OFFSET_S = 86_400.0


class Network(WireModel):
    """The network of a run: a constant link, a trace (of the shaper's, or from a file), or none of these."""

    name: str = Field(min_length=1, max_length=100)
    link: LinkSetting | None = None
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
