"""Requests of viewers, along the movements of the repository, in a scene's own frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks.load.plan import Plan
from tigas_common.wire.render import RenderRequest, SceneInfo, StartCamera
from tigas_experiments.movement.table import MovementError

STROLL = Path(__file__).parents[3] / "traces/movement/stroll.csv"
SCENE = SceneInfo(
    id="garden", name="Garden", state="loaded", error=None, gaussians=1, sh_degree=0, file_bytes=1, memory_bytes=1,
    preview="", up=(0, -1, 0), camera=StartCamera(position=(1, 2, 3), look_at=(1, 2, 7)), background=(0, 0, 0),
)  # fmt: skip


def plan(movement: Path = STROLL, frames_per_s: float = 30, **more: Any) -> Plan:
    address = ("127.0.0.1", 4433)
    return Plan.of(address, SCENE, [movement], transport="webtransport", frames_per_s=frames_per_s, profile=2, **more)


def test_a_view_for_every_frame_of_a_minute() -> None:
    made = plan()
    assert len(made.routes[0]) == pytest.approx(60 * 30, abs=2)
    first = RenderRequest.model_validate_json(made.request(0, 0, 7))
    assert (first.scene, first.seq, first.profile, first.width, first.height) == ("garden", 7, 2, 1280, 720)
    assert first.position == pytest.approx((1, 2, 3), abs=0.1)  # where the start camera stands
    assert not first.depth


def test_a_faster_viewer_sees_the_same_in_smaller_steps() -> None:
    slow, fast = plan(frames_per_s=10), plan(frames_per_s=20)
    assert slow.routes[0][30] == fast.routes[0][60]


def test_a_route_begins_anew_at_its_end() -> None:
    made = plan(depth=True)
    assert made.request(0, len(made.routes[0]) + 3, 1) == made.request(0, 3, 1)
    assert RenderRequest.model_validate_json(made.request(0, 3, 1)).depth


def test_a_plan_comes_through_a_line_of_text() -> None:
    made = plan()
    text = made.to_json()
    assert "\n" not in text
    assert Plan.from_json(text) == made


def test_what_is_no_movement_is_refused(tmp_path: Path) -> None:
    (tmp_path / "no.csv").write_text("a,b\n1,2\n")
    with pytest.raises(MovementError):
        plan(tmp_path / "no.csv")
