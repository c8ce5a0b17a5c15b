"""Metrics of a run, computed from its records as defined in docs/experiments.md. All functions are pure.

Functions that compute several metrics return them by name in `report.metrics.METRICS`: None if there is nothing to
measure, inf if too many inputs were never answered. All modes are measured from the same two lists, the sampled poses
and the displayed frames, independently of a player's own notion of latency or stalls. A reprojected frame has two
poses: `content_pose`, of its pixels, and `view_pose`, the displayed one. Latency, ages and new views refer to contents
by default.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import TypeVar, get_args

from tigas_experiments.wire.figures import AGE_EVERY_MS, INTERACTIVE_MS, USUAL_INTERVAL_MS
from tigas_experiments.wire.recording import Fate, Input, Reply, Request, ShownFrame, Traffic

FREEZE_MS, FREEZE_HISTORY = 150.0, 30
"""Constants of W3C webrtc-stats."""
IN_TIME = f"inputs_within_{INTERACTIVE_MS:g}ms_pct"
"""Name of the share of inputs that were shown immediately."""
Values = dict[str, float | None]
PoseOf = Callable[[ShownFrame], int]
T = TypeVar("T")


def content_pose(frame: ShownFrame) -> int:
    """The pose of the frame's pixels."""
    return frame.pose


def view_pose(frame: ShownFrame) -> int:
    """The displayed pose, reprojected or not."""
    return frame.pose if frame.view is None else frame.view


def percentile(values: Sequence[float], rank: float) -> float | None:
    """The nearest-rank percentile (rank 0 to 1), as computed by the page; None without values."""
    ordered = sorted(values)
    return ordered[max(0, math.ceil(rank * len(ordered)) - 1)] if ordered else None


def answer_times(inputs: Sequence[Input], frames: Sequence[ShownFrame], pose_of: PoseOf = content_pose) -> list[float]:
    """Milliseconds from each input until a frame of its pose or a later one was on screen; inf if there was none."""
    latencies: list[float] = []
    frame, newest = 0, -1
    for entry in inputs:  # poses and times increase, so the answering frame never goes back
        while frame < len(frames) and (newest := max(newest, pose_of(frames[frame]))) < entry.pose:
            frame += 1
        latencies.append(frames[frame].at - entry.at if frame < len(frames) else math.inf)
    return latencies


def latencies(inputs: Sequence[Input], frames: Sequence[ShownFrame], interval_ms: float = USUAL_INTERVAL_MS) -> Values:
    """Motion-to-photon latency of the content: the time until pixels of a pose or a later one were on screen.

    Covers all inputs, with unanswered ones as slower than any; `interval_ms` is the display's frame interval.
    """
    values = answer_times(inputs, frames)

    def within(limit: float) -> float | None:
        return sum(value <= limit for value in values) / len(values) * 100 if values else None

    return {
        "inputs": len(values),
        "inputs_missed": sum(entry.missed for entry in inputs),
        "inputs_unanswered": sum(map(math.isinf, values)),
        **_percentiles("motion_to_photon", values, 50, 90, 95, 99),
        IN_TIME: within(INTERACTIVE_MS),
        "inputs_within_a_frame_less_pct": within(INTERACTIVE_MS - interval_ms),
        "inputs_within_a_frame_more_pct": within(INTERACTIVE_MS + interval_ms),
    }


def view_latencies(inputs: Sequence[Input], frames: Sequence[ShownFrame]) -> Values:
    """Time until the picture on screen was warped to a pose or a later one, regardless of the age of its pixels;
    without warping, motion-to-photon latency.
    """
    return _percentiles("view_latency", answer_times(inputs, frames, view_pose), 50, 90, 95, 99)


def find_new_views(frames: Sequence[ShownFrame], pose_of: PoseOf = content_pose) -> list[ShownFrame]:
    """The frames that show a later pose than all frames before them."""
    found: list[ShownFrame] = []
    for frame in frames:
        if not found or pose_of(frame) > pose_of(found[-1]):
            found.append(frame)
    return found


def new_view_ages(inputs: Sequence[Input], frames: Sequence[ShownFrame]) -> list[tuple[float, float]]:
    """For each new view of a sampled pose: the time of its display, and the time since its pose was sampled, in ms."""
    sampled = {entry.pose: entry.at for entry in inputs}
    return [(frame.at, frame.at - sampled[frame.pose]) for frame in find_new_views(frames) if frame.pose in sampled]


def frame_ages(inputs: Sequence[Input], frames: Sequence[ShownFrame]) -> Values:
    """Ages of frames, unlike `latencies`, which are of inputs: inputs that were never requested do not count here."""
    return _times("frame_age", [ms for _, ms in new_view_ages(inputs, frames)], 50, 95)


def age_parts(inputs: Sequence[Input], frames: Sequence[ShownFrame], replies: Sequence[Reply]) -> dict[str, float]:
    """Means of the consecutive parts of the age of new views, in ms; empty without server times, as with DASH.

    `wait`: from the input to the request, while too many requests are in flight. `network`: both directions, including
    the server's time outside its three stages. `page`: the rest, from the last byte to the screen.
    """
    sampled = {entry.pose: entry.at for entry in inputs if not entry.missed}
    answers = {reply.pose: reply for reply in reversed(replies) if reply.server is not None}  # first per pose
    found: list[dict[str, float]] = []
    for frame in find_new_views(frames):
        reply, at = answers.get(frame.pose), sampled.get(frame.pose)
        if at is None or reply is None or reply.at > frame.at:
            continue
        assert reply.server is not None
        stages = reply.server.model_dump(include={"queue", "render", "encode"})
        enhance = min(frame.enhance_ms or 0.0, frame.at - reply.at)
        found.append(
            {
                "wait": reply.asked_at - at,
                **stages,
                "network": reply.time_ms - sum(stages.values()),
                "enhance": enhance,
                "page": frame.at - reply.at - enhance,
            }
        )
    return {part: sum(each[part] for each in found) / len(found) for part in (found[0] if found else ())}


def content_ages(
    inputs: Sequence[Input], frames: Sequence[ShownFrame], duration_ms: float, interval_ms: float = USUAL_INTERVAL_MS
) -> Values:
    """Time since the viewer's pose last equalled that of the picture on screen; None if the viewer did not move.

    Sampled every AGE_EVERY_MS until the end of the movement. 0 while the picture has the viewer's current pose,
    otherwise the time since the last display frame, one every `interval_ms`, in which it did.
    """
    poses = [entry.pose for entry in inputs]
    ages: list[float] = []
    shown, frame = -1, 0  # initially, the picture from before the run
    for tick in range(math.ceil(duration_ms / AGE_EVERY_MS) if inputs else 0):
        at = tick * AGE_EVERY_MS
        while frame < len(frames) and frames[frame].at <= at:
            shown, frame = frames[frame].pose, frame + 1
        newer = bisect_right(poses, shown)
        left = newer < len(inputs) and inputs[newer].at <= at
        ages.append(at - inputs[newer].at + interval_ms if left else 0.0)
    return _times("content_age", ages, 50, 95)


def response_times(replies: Sequence[Reply]) -> Values:
    """Time from sending a request to the last byte of its frame, as in the paper.

    It excludes the page's part: waiting to send the request, decoding, and waiting for the display.
    """
    return _times("response_time", [reply.time_ms for reply in replies if reply.asked_at >= 0], 50, 95)


def requests(sent: Sequence[Request]) -> Values:
    """Numbers of requests by outcome; None for DASH and early recordings."""
    fates = Counter(request.fate for request in sent)
    return {"requests_sent": len(sent), **{f"requests_{fate}": fates[fate] for fate in get_args(Fate)}} if sent else {}


def render_times(replies: Sequence[Reply]) -> Values:
    """Server times of received frames."""
    values = [reply.server.render for reply in replies if reply.asked_at >= 0 and reply.server is not None]
    return _times("render", values, 50)


def freezes(inputs: Sequence[Input], frames: Sequence[ShownFrame], ended_ms: float) -> list[float]:
    """Gaps in ms without a new or reprojected picture that W3C webrtc-stats would count in `freezeCount`: at least
    max(3δ, δ + 150 ms) long, with δ the mean of the last 30 gaps. Time in which the viewer stood still is excluded, and
    constant latency does not count.
    """
    gaps: deque[float] = deque(maxlen=FREEZE_HISTORY)
    long: list[float] = []
    for gap in _gaps(inputs, find_new_views(frames, view_pose), ended_ms):
        usual = mean(gaps) or 0.0
        if gap >= max(3 * usual, usual + FREEZE_MS):
            long.append(gap)
        gaps.append(gap)
    return long


def _gaps(inputs: Sequence[Input], views: Sequence[ShownFrame], ended_ms: float) -> Iterator[float]:
    """Time in ms from each view to the next, less the time for which the viewer stood still after its pose."""
    if not inputs:
        return
    poses = [entry.pose for entry in inputs]
    own = [shown for shown in views if view_pose(shown) >= poses[0]]
    ends = [*(shown.at for shown in own), ended_ms][1:]
    for shown, until in zip(own, ends, strict=True):
        following = bisect_right(poses, view_pose(shown))
        if following == len(inputs):
            return  # no newer pose
        yield max(0.0, until - shown.at - (inputs[following].at - inputs[following - 1].at))
    if not own:
        yield ended_ms - inputs[0].at


def rates(frames: Sequence[ShownFrame], duration_ms: float) -> Values:
    """Rates of frames and new views during the movement."""
    during = [frame for frame in frames if 0 <= frame.at <= duration_ms]
    seconds = duration_ms / 1000
    return {"frames_per_s": len(during) / seconds, "new_views_per_s": len(find_new_views(during)) / seconds}


def _times_on_screen(
    frames: Sequence[ShownFrame], duration_ms: float, of: Callable[[ShownFrame], T | None]
) -> list[tuple[T, float]]:
    """Known values of the frames on screen until the end of the movement, each with its time on screen in ms."""
    known = [(frame.at, value) for frame in frames if frame.at <= duration_ms and (value := of(frame)) is not None]
    ends = [*(at for at, _ in known[1:]), duration_ms]
    return [(value, until - at) for (at, value), until in zip(known, ends, strict=False)]


def rungs(frames: Sequence[ShownFrame], duration_ms: float) -> dict[int, float]:
    """Each rung's share of the time for which frames of known rungs were on screen, until the end of the movement."""
    lasted: dict[int, float] = {}
    for rung, time in _times_on_screen(frames, duration_ms, lambda frame: frame.rung):
        lasted[rung] = lasted.get(rung, 0.0) + time
    total = sum(lasted.values())
    return {rung: time / total for rung, time in sorted(lasted.items())} if total > 0 else {}


def rung_changes(frames: Sequence[ShownFrame], duration_ms: float) -> int:
    """Number of changes of the known rung on screen."""
    spans = _times_on_screen(frames, duration_ms, lambda frame: frame.rung)
    return sum(before != after for (before, _), (after, _) in pairwise(spans))


def mean_height(frames: Sequence[ShownFrame], duration_ms: float) -> float | None:
    """Mean frame height in pixels on screen until the end of the movement, weighted by time; None without frames."""
    return _weighted_mean(_times_on_screen(frames, duration_ms, lambda frame: frame.height))


def median_height(frames: Sequence[ShownFrame], duration_ms: float) -> float | None:
    """Median frame height on screen, weighted by time; None without frames."""
    spans = _times_on_screen(frames, duration_ms, lambda frame: frame.height)
    half, passed = sum(time for _, time in spans) / 2, 0.0
    for height, time in sorted(spans):
        passed += time
        if passed >= half > 0:
            return height
    return None


def filled_share(frames: Sequence[ShownFrame], duration_ms: float) -> float | None:
    """Share of the picture outside the newest frame, until the end of the movement, weighted by time; None without
    reprojection.
    """
    return _weighted_mean(_times_on_screen(frames, duration_ms, lambda frame: frame.filled))


def warp_times(frames: Sequence[ShownFrame], duration_ms: float) -> Values:
    """Time for which reprojecting a picture occupied the page's main thread, until the end of the movement."""
    values = [frame.warp_ms for frame in frames if frame.warp_ms is not None and 0 <= frame.at <= duration_ms]
    return _times("warp", values, 95)


def received_kbps(traffic: Sequence[Traffic], duration_ms: float) -> float | None:
    """Mean rate at which the page received frames or segments until the end of the movement; None if not recorded."""
    during = [entry for entry in traffic if entry.at <= duration_ms]
    if len(during) < 2 or during[-1].at <= during[0].at:
        return None
    return (during[-1].bytes - during[0].bytes) * 8 / (during[-1].at - during[0].at)


def mean_over_time(points: Sequence[tuple[float, float]]) -> float | None:
    """Mean of (ms, value since the previous point), weighted by time; None with fewer than two points."""
    return _weighted_mean([(value, at - before) for (before, _), (at, value) in pairwise(points)])


def _weighted_mean(spans: Sequence[tuple[float, float]]) -> float | None:
    total = sum(weight for _, weight in spans)
    return sum(value * weight for value, weight in spans) / total if total > 0 else None


def mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None


def _times(name: str, values: Sequence[float], *ranks: int) -> Values:
    """Mean and percentiles of times in ms."""
    return {f"{name}_mean_ms": mean(values), **_percentiles(name, values, *ranks)}


def _percentiles(name: str, values: Sequence[float], *ranks: int) -> Values:
    return {f"{name}_p{rank}_ms": percentile(values, rank / 100) for rank in ranks}
