"""A run as the page performs it: the viewer's settings, and the movement to play and record."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tigas_experiments.wire.movement import TimedPose
from tigas_experiments.wire.run import Configuration, RunPlan


def page_settings(configuration: Configuration) -> dict[str, Any]:
    """The viewer's settings before a run: everything that is not said here has its default."""
    mode, profile = configuration.mode, configuration.profile
    chosen: dict[str, Any]
    if configuration.local:
        # The mode begins with the recording, which includes its download.
        chosen = {"mode": "stateless", "localForm": configuration.download_form}
    elif mode == "webrtc":
        chosen = {"mode": "webrtc", "webrtcStream": "h264-30"}
    elif configuration.streamed:
        preset = mode.removeprefix("dash-")
        representation = configuration.dash_representation
        chosen = {
            "mode": "dash",
            "dashPreset": preset,
            "dashFrameRate": configuration.dash_frame_rate,
            "dashTransport": configuration.dash_transport,
            "dashRepresentation": None if representation is None else representation.model_dump(),
        }
    elif isinstance(profile, int):
        chosen = {"mode": mode, "controller": "fixed", "profile": profile}
    else:
        chosen = {"mode": mode, "controller": profile}
    # Nothing next to the picture, so that the stage is the viewport; no second request for a view that stands still;
    # one format, so that a rung is the same picture on every link.
    enhancement = {"restore": configuration.restore, "upscale": configuration.upscale}
    motion = configuration.model_dump(include={"reprojection", "prediction", "overscan", "depth", "surround"})
    return {
        **chosen,
        **enhancement,
        **motion,
        "seed": configuration.seed,
        "sidebar": False,
        "hud": False,
        "refine": False,
        "webp": False,
    }


def run_plan(configuration: Configuration, points: Sequence[TimedPose]) -> RunPlan:
    """A run with its movement in the scene's own frame."""
    return RunPlan(
        points=tuple(points),
        duration_ms=configuration.duration_s * 1000,
        capture_every_ms=configuration.capture_every_ms,
        sample_stride=configuration.sample_stride,
        download=configuration.local,
    )
