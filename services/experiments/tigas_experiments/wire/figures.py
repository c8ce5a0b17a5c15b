"""The figures of one run."""

from __future__ import annotations

from tigas_common.wire.model import WireModel

INTERACTIVE_MS = 108.0
"""The motion-to-photon latency that counts as immediate: between the sixth and the seventh frame of a 60 Hz display, as
100 ms are the sixth itself, where a hair decides (docs/experiments.md).
"""
USUAL_INTERVAL_MS = 1000 / 60
"""The interval between a display's frames if a recording does not say it."""
AGE_EVERY_MS = 5.0
"""The interval at which the age of the picture on the screen is sampled."""


class Latencies(WireModel):
    """Motion-to-photon latency of the content, in ms: until pixels of a pose or of a later one were on screen. None:
    that share of the inputs was never answered, or there are none.
    """

    inputs: int
    missed: int
    """Of these, poses that a page that stalled should have sampled."""
    unanswered: int
    """Inputs that no frame ever showed, although recording went on for seconds."""
    p50: float | None
    p90: float | None
    p95: float | None
    p99: float | None
    share_interactive: float | None
    """Of all inputs, those shown within INTERACTIVE_MS, 0 to 1."""
    share_frame_less: float | None
    """The same, were the limit one frame of the display less."""
    share_frame_more: float | None
    """And one more."""


class ViewLatencies(WireModel):
    """Time until the picture on screen was warped to a pose or to a later one, in ms, whatever the age of its pixels;
    without warping, motion-to-photon latency. None: see there.
    """

    unanswered: int
    """Inputs that no picture ever turned to."""
    p50: float | None
    p90: float | None
    p95: float | None
    p99: float | None


class FrameAges(WireModel):
    """From the sample of a frame's own pose to that frame on the screen, in ms; None without frames."""

    frames: int
    """New views of poses that were sampled during the run."""
    mean: float | None
    p50: float | None
    p95: float | None


class ContentAges(WireModel):
    """How long ago the viewer was last where the picture on the screen is from, sampled by time, in ms; None if the
    viewer did not move.
    """

    mean: float | None
    p50: float | None
    p95: float | None


class ResponseTimes(WireModel):
    """From sending a request to the last byte of its frame, in ms, as the paper has it; None without replies."""

    replies: int
    """Answers to requests of the run."""
    mean: float | None
    p50: float | None
    p95: float | None


class Requests(WireModel):
    """Outcomes of the requests sent during the run (`tigas_experiments.wire.recording.Fate`)."""

    sent: int
    shown: int
    overtaken: int
    cancelled: int
    dropped: int
    unanswered: int


class RenderTimes(WireModel):
    """Server times of received frames, in ms; None if it sent none."""

    mean: float | None
    p50: float | None


class Freezes(WireModel):
    """Times at which the picture stood, neither new nor turned, although the viewer moved."""

    count: int
    total_ms: float
    longest_ms: float


class WarpTimes(WireModel):
    """How long turning a picture kept the page's main thread, in ms; None where it turned none."""

    mean: float | None
    p95: float | None


class Rates(WireModel):
    """Frames over the movement's duration."""

    shown: int
    per_s: float
    new_views: int
    """Frames that show a later pose than any before: a video repeats frames, a frame per pose does not."""
    new_views_per_s: float


class Rungs(WireModel):
    """Which rungs of the ladder were on the screen."""

    share: dict[int, float]
    """Rung → share of the time."""
    switches: int

    @property
    def mean(self) -> float | None:
        """Weighted by time; None if no rung was known."""
        return sum(rung * share for rung, share in self.share.items()) if self.share else None


class QualityFigures(WireModel):
    """Means over the kept pictures of a run; None where none could be compared so."""

    pictures: int
    picture_psnr_db: float | None
    """Against the pose that each was rendered for; excludes warped pictures."""
    picture_ssim: float | None
    view_psnr_db: float | None
    """Against the pose to which the page warped it, or else the viewer's pose when it appeared on screen."""
    view_ssim: float | None
    seen_psnr_db: float | None
    """Against the viewer's pose at the clock's tick, the ideal picture. None for early recordings."""
    seen_ssim: float | None
    uncovered: float | None = None
    """Share of the picture, 0 to 1, that was never rendered. None for early recordings."""
    seen_lpips: float | None = None
    """Where `tigas quality` was run with the ground truth of the kept pictures."""


class Figures(WireModel):
    """Figures of a complete run."""

    latencies: Latencies
    view_latencies: ViewLatencies
    frame_ages: FrameAges
    content_ages: ContentAges
    response_times: ResponseTimes
    requests: Requests | None
    """None of DASH, and of early recordings."""
    render_times: RenderTimes
    frames: Rates
    freezes: Freezes
    rungs: Rungs
    mean_height: float | None
    """Of the frames shown, weighted by time, in pixels."""
    median_height: float | None
    filled: float | None
    """The page's estimate of the share of the picture not covered by the newest frame, 0 to 1, weighted by time; None
    without warping.
    """
    warp_times: WarpTimes
    received_kbps: float | None
    """By the page: frames or segments."""
    delivered_kbps: float | None
    """By the link towards the client: everything, with headers."""
    sent_kbps: float | None
    """By the link from the client."""
    target_kbps: float | None
    """Mean rate of the link towards the client."""
    trace_start_ms: float | None
    """The trace's position when the run began."""
    drops: int | None
    quality: QualityFigures | None
