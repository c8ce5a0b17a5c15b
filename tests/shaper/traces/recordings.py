"""Short recordings in published formats, and helpers for tests."""

from __future__ import annotations

from tigas_shaper.traces.formats import parse_trace
from tigas_shaper.traces.trace import NetworkTrace

GHENT = "1450274031248 725 51.06 3.73 3263799 725\n1450274032248 1725 51.06 3.73 4226240 1000\n"
SABRE = """[
 {"duration_ms": 725, "bandwidth_kbps": 36014, "latency_ms": 20},
 {"duration_ms": 1000, "bandwidth_kbps": 0}
]
"""
IRISH = """Timestamp,Longitude,NetworkMode,DL_bitrate,UL_bitrate
2019.12.16_14.23.30,-8.4,5G,-,7
2019.12.16_14.23.32,-8.4,5G,100,66
2019.12.16_14.23.32,-8.4,5G,300,36
2019.12.16_14.23.33,-8.4,5G,-,36
2019.12.16_14.23.37,-8.4,5G,50,-
"""
HEADER = "t_ms,down_kbps,up_kbps,delay_ms,jitter_ms,loss_pct\n"
"""Of our own format."""


def read(text: str | bytes, format: str | None = None) -> NetworkTrace:
    """The trace in a text of any format."""
    return parse_trace("t", text.encode() if isinstance(text, str) else text, format=format)
