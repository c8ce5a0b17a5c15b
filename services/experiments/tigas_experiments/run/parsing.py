"""Parsers for user input about runs, from files and options."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

from tigas_common.wire.shaper import TRACE_SUFFIXES, LinkSetting
from tigas_experiments.wire.run import LINK_TERMS, UNSHAPED, USUAL_UP_KBPS, Network

MOST_PICTURES = 120
"""Maximum number of pictures per run, as they stay in the page's memory until its end."""
_PART = re.compile(r"(?P<value>\d+(?:\.\d+)?)(?P<unit>mbit-up|kbit-up|mbit|kbit|ms-rtt|ms-jitter|%-loss)", re.ASCII)
_UNITS = {
    **{term.unit: (term.field, term.scale) for term in LINK_TERMS},
    "kbit": ("down_kbps", 1.0),
    "kbit-up": ("up_kbps", 1.0),
}
_OVERRIDE = re.compile(r"(?P<trace>.+),(?P<rtt>\d+(?:\.\d+)?)ms-rtt", re.ASCII)
_PIXELS = re.compile("[0-9]{1,5}")


def parse_network(text: str, directory: Path = Path()) -> Network:
    """Parse a network: `20mbit,20ms-rtt`, `unshaped`, a trace (file or name), or `TRACE,100ms-rtt`.

    File paths are relative to `directory` and kept unchanged. Raises ValueError with one sentence.
    """
    if text == UNSHAPED:
        return Network()
    override = _OVERRIDE.fullmatch(text)
    trace, rtt_ms = (override["trace"], float(override["rtt"])) if override else (text, None)
    path = Path(trace)
    with suppress(OSError):  # the name may be too long
        if (directory / path).is_file():
            return Network(trace=path.name[:100], trace_file=path, rtt_ms=rtt_ms)
    if _PART.match(text):
        return Network(link=_constant(text))
    if path.name != trace or path.suffix.lower() in TRACE_SUFFIXES:
        raise ValueError(f"there is no trace file {trace!r}")
    return Network(trace=trace, rtt_ms=rtt_ms)


def parse_viewport(text: str) -> tuple[int, int]:
    """Parse width and height from `640x360`. Raises ValueError with one sentence."""
    width, _, height = text.partition("x")
    if not (_PIXELS.fullmatch(width) and _PIXELS.fullmatch(height)):
        raise ValueError(f"{text[:100]!r} is not WIDTHxHEIGHT, such as 1280x720")
    return int(width), int(height)


def capture_interval_ms(every_s: float, duration_s: float) -> float:
    """Interval between captures, at least as long as MOST_PICTURES per run require; 0 for none."""
    return max(every_s, duration_s / MOST_PICTURES) * 1000 if every_s else 0.0


def _constant(text: str) -> LinkSetting:
    fields: dict[str, float] = {}
    for part in text.split(","):
        found = _PART.fullmatch(part.strip())
        if found is None:
            raise ValueError(
                f"{part.strip()!r} is not part of a link, such as 20mbit, 5mbit-up, 20ms-rtt, 2ms-jitter or 0.1%-loss"
            )
        name, factor = _UNITS[found["unit"]]
        if name in fields:
            raise ValueError(f"{text!r} has {found['unit']} twice")
        fields[name] = float(found["value"]) * factor
    if "down_kbps" not in fields:
        raise ValueError(f"{text!r} has no rate, such as 20mbit")
    return LinkSetting(**{"up_kbps": USUAL_UP_KBPS, **fields})
