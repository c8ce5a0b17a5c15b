"""A RenderRequest from a pose and a lens is read back unchanged by the renderer."""

from __future__ import annotations

import pytest

from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import RenderRequest

LENS = Intrinsics(fx=900, fy=800, cx=640, cy=300, width=1280, height=720)


def test_a_view_is_asked_for_from_its_pose_through_its_lens() -> None:
    pose = Pose.from_euler(30, -10, 5, (1.0, 2.0, 3.0))
    sent = RenderRequest.at("courtyard", pose, LENS, profile=2, format="png")
    read = RenderRequest.model_validate_json(sent.model_dump_json(exclude_none=True))
    assert (read.scene, read.profile, read.format, read.intrinsics) == ("courtyard", 2, "png", LENS)
    assert read.pose.position == pose.position
    for ours, theirs in zip(read.pose.rotation, pose.rotation, strict=True):
        assert ours == pytest.approx(theirs, abs=1e-12)
