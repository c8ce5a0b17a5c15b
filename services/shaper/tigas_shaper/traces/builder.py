"""Builds a trace from states and their durations, as found in recordings."""

from __future__ import annotations

from pydantic import ValidationError

from tigas_common.parsing import sentence
from tigas_common.wire.shaper import MAX_DURATION_MS, LinkSetting
from tigas_shaper.traces.trace import MAX_STEPS, NetworkTrace, TraceError


class TraceBuilder:
    """Puts a trace together from states and how long each lasts."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._times: list[int] = []
        self._states: list[LinkSetting] = []
        self._end = 0.0

    def add(
        self,
        line: int,
        lasts_ms: float,
        down_kbps: float,
        up_kbps: float,
        delay_ms: float = 0.0,
        jitter_ms: float = 0.0,
        loss_pct: float = 0.0,
    ) -> None:
        """Append a state. Times are rounded to whole milliseconds as they add up, so that nothing drifts; states
        shorter than that are dropped.
        """
        start, self._end = round(self._end), self._end + lasts_ms
        if self._end > MAX_DURATION_MS:
            raise TraceError(f"Line {line}: a trace may last 30 days; this one lasts longer.")
        if round(self._end) == start:
            return
        if len(self._times) == MAX_STEPS:
            raise TraceError(f"Line {line}: a trace may have {MAX_STEPS:,} steps; this one has more.")
        try:
            state = LinkSetting(
                down_kbps=down_kbps, up_kbps=up_kbps, delay_ms=delay_ms, jitter_ms=jitter_ms, loss_pct=loss_pct
            )
        except ValidationError as error:
            raise TraceError(f"Line {line}: {sentence(error)}") from None
        self._times.append(start)
        self._states.append(state)

    def build(self) -> NetworkTrace:
        """The trace."""
        if not self._times:
            raise TraceError("The file has no step that lasts a millisecond.")
        return NetworkTrace(self._name, tuple(self._times), tuple(self._states), round(self._end))
