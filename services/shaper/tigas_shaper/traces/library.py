"""The available traces: files in a directory, and uploaded ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from tigas_common.errors import TigasError
from tigas_common.wire.shaper import TracePoints, TraceSummary
from tigas_shaper.traces.formats import load_trace, parse_trace, trace_name
from tigas_shaper.traces.trace import NetworkTrace, TraceError

MAX_UPLOADS = 16
"""Maximum number of uploaded traces; the oldest are dropped."""
POINTS = 600
"""Maximum number of points in a trace's outline."""


class UnknownTrace(TigasError):
    status, type, title = 404, "unknown-trace", "There is no such network trace"


class TraceLibrary:
    """Traces by name; an uploaded trace hides a file with the same name. Reading is too slow for an event loop."""

    def __init__(self, directory: Path | None) -> None:
        self._directory = directory
        self._uploads: dict[str, NetworkTrace] = {}
        self._files: dict[Path, tuple[tuple[int, int], NetworkTrace | TraceError]] = {}
        """Parsed files by path, each with its time and size when it was read."""

    def summaries(self) -> list[TraceSummary]:
        """All traces, by name; the directory is searched anew."""
        found = {name: summarise(trace, uploaded=True) for name, trace in list(self._uploads.items())}
        for path in self._paths():
            name = trace_name(path.name)
            if name not in found:
                trace = self._load(path)
                found[name] = (
                    TraceSummary(name=name, uploaded=False, error=trace.detail)
                    if isinstance(trace, TraceError)
                    else summarise(trace, uploaded=False)
                )
        return [found[name] for name in sorted(found)]

    def get(self, name: str) -> NetworkTrace:
        """A trace by name. Raises UnknownTrace and TraceError."""
        if name in self._uploads:
            return self._uploads[name]
        for path in self._paths():
            if trace_name(path.name) == name:
                trace = self._load(path)
                if isinstance(trace, TraceError):
                    raise trace
                return trace
        raise UnknownTrace(f"There is no trace named {name[:100]!r}.")

    def add(self, filename: str, data: bytes) -> NetworkTrace:
        """Store an uploaded trace in place of one of the same name, or of the oldest. Raises TraceError."""
        trace = parse_trace(trace_name(filename), data)
        self._uploads.pop(trace.name, None)
        self._uploads[trace.name] = trace
        if len(self._uploads) > MAX_UPLOADS:
            del self._uploads[next(iter(self._uploads))]
        return trace

    def _paths(self) -> Iterator[Path]:
        """Files in the directory; none if it has become unreadable."""
        if self._directory is not None:
            with suppress(OSError):
                for path in sorted(self._directory.iterdir()):
                    if path.is_file() and not path.name.startswith((".", "README")):
                        yield path

    def _load(self, path: Path) -> NetworkTrace | TraceError:
        try:
            stat = path.stat()
            version = (stat.st_mtime_ns, stat.st_size)
            known, trace = self._files.get(path, (None, None))
            if trace is not None and known == version:
                return trace
            trace = load_trace(path)
        except TraceError as error:
            trace = error
        except OSError as error:
            return TraceError(f"{path.name} cannot be read: {error.strerror or error}.")
        self._files[path] = (version, trace)
        return trace


def summarise(trace: NetworkTrace, *, uploaded: bool) -> TraceSummary:
    return TraceSummary(
        name=trace.name,
        uploaded=uploaded,
        duration_ms=trace.duration_ms,
        steps=len(trace.states),
        mean_down_kbps=trace.mean_down_kbps,
        min_down_kbps=min(trace.down_kbps),
        max_down_kbps=max(trace.down_kbps),
        mean_up_kbps=trace.mean_up_kbps,
        outages=len(trace.outages),
    )


def trace_outline(trace: NetworkTrace) -> TracePoints:
    """A trace's outline: unchanged if it is short, otherwise means over equal intervals."""
    times: Sequence[float] = trace.times_ms
    down: Sequence[float] = trace.down_kbps
    up: Sequence[float] = trace.up_kbps
    if len(times) > POINTS:
        span = trace.duration_ms / POINTS
        times, down, up = [index * span for index in range(POINTS)], [0.0] * POINTS, [0.0] * POINTS
        for time, step, state in zip(trace.times_ms, trace.steps_ms, trace.states, strict=True):
            end = time + step
            for index in range(int(time / span), min(POINTS, int(end / span) + 1)):
                overlap = max(0.0, min(end, (index + 1) * span) - max(time, index * span)) / span
                down[index] += state.down_kbps * overlap
                up[index] += state.up_kbps * overlap
    return TracePoints(
        name=trace.name, duration_ms=trace.duration_ms, times_ms=tuple(times), down_kbps=tuple(down), up_kbps=tuple(up)
    )
