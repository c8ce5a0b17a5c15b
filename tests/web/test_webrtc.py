"""The mode WebRTC: Chromium receives a video of the views from the packager's one UDP port."""

from __future__ import annotations

import json
import math

from playwright.sync_api import expect

from tests.web.conftest import OpenPage
from tests.web.modes import wait_for_sessions, wait_for_stream, with_settings
from tests.web.server import Packager
from tests.web.stage import SCENE
from tigas_experiments.wire.recording import Recording

SMALL = {"width": 260, "height": 200}
PLAIN = {"prediction": "off", "reprojection": False, "sidebar": False, "hudDetails": True}
TURN_MS = 1000
TURN = [
    {"t_ms": t, "position": [0, 0, 0], "quaternion": [0, math.sin(t / 2000), 0, math.cos(t / 2000)]}
    for t in range(0, TURN_MS + 1, 50)
]


def test_a_walk_over_webrtc_is_measured_frame_by_frame(
    viewer_url: str, packager: Packager, open_page: OpenPage
) -> None:
    others = names(packager)
    page = open_page(SCENE, url=viewer_url, viewport=SMALL, **with_settings(viewer_url, mode="webrtc", **PLAIN))
    wait_for_stream(page, at_least=5)
    plan = {"points": TURN, "duration_ms": TURN_MS, "capture_every_ms": 400, "sample_stride": 0}
    page.wait_for_function("() => tigas.state().ready")
    recording = Recording.model_validate_json(json.dumps(page.evaluate("plan => tigas.run(plan)", plan)))
    assert recording.webrtc is not None
    assert recording.webrtc.codec == "H264"
    assert {frame.side for frame in recording.frames} == {"webrtc"}
    assert recording.frames[-1].pose == recording.inputs[-1].pose, "the last view never came"
    assert len({frame.pose for frame in recording.frames}) > 5
    assert recording.traffic[-1].bytes > 1000
    assert recording.captures
    expect(page.locator('[data-stat="codec"]')).to_contain_text("H.264")
    (stream,) = names(packager) - others
    page.evaluate("tigas.settings({ mode: 'stateless' })")
    wait_for_sessions(packager, lambda sessions: stream not in {one["id"] for one in sessions})


def names(packager: Packager) -> set[str]:
    """Its streams' names."""
    return {one["id"] for one in packager.sessions()}
