"""Combined answers of several engines."""

from __future__ import annotations

import json
from typing import Any

import pytest

from tigas_common.wire.render import SceneInfo, Training
from tigas_render.workers import aggregate


def info(id: str = "garden", **changes: Any) -> SceneInfo:
    known: dict[str, Any] = {
        "id": id,
        "name": id,
        "state": "unloaded",
        "error": None,
        "gaussians": None,
        "sh_degree": None,
        "file_bytes": 1,
        "memory_bytes": 0,
        "preview": "",
        "up": (0, -1, 0),
        "camera": None,
        "background": (0, 0, 0),
    }
    return SceneInfo(**known | changes)


def bodies(*models: SceneInfo | Training) -> dict[str, bytes]:
    return {f"device {number}": model.model_dump_json().encode() for number, model in enumerate(models)}


def test_a_scene_is_loaded_if_it_is_anywhere_and_what_any_knows_is_known() -> None:
    one = info(state="loaded", gaussians=7, memory_bytes=100, file_sha256="ab")
    other = info(state="loading", memory_bytes=0, sh_degree=3)
    for given in (bodies(one, other), bodies(other, one)):
        assert SceneInfo.model_validate_json(aggregate.merge_scene(given)) == one.model_copy(update={"sh_degree": 3})
    both = SceneInfo.model_validate_json(aggregate.merge_scene(bodies(one, one)))
    assert both.memory_bytes == 200


def test_a_scene_is_broken_only_if_no_device_can_have_it() -> None:
    broken = info(state="broken", error="It is broken.")
    assert SceneInfo.model_validate_json(aggregate.merge_scene(bodies(broken, info()))) == info()
    assert SceneInfo.model_validate_json(aggregate.merge_scene(bodies(broken, broken))) == broken


def test_scenes_that_only_one_engine_has_found_are_listed_too() -> None:
    of = {"x": [info("a"), info("c")], "y": [info("b"), info("a", state="loaded")]}
    given = {name: json.dumps([each.model_dump() for each in infos]).encode() for name, infos in of.items()}
    listed = [(each["id"], each["state"]) for each in json.loads(aggregate.merge_scenes(given))]
    assert listed == [("a", "loaded"), ("b", "unloaded"), ("c", "unloaded")]


@pytest.mark.parametrize(
    ("one", "other", "together"),
    [("idle", "running", "running"), ("done", "idle", "done"), ("failed", "idle", "failed"), ("idle", "idle", "idle")],
)
def test_a_training_is_that_of_the_engine_that_knows_of_one(one: Any, other: Any, together: str) -> None:
    merged = aggregate.merge_training(bodies(Training(state=one), Training(state=other)))
    assert json.loads(merged)["state"] == together
    assert aggregate.is_running(merged) == (together == "running")


def test_metrics_of_engines_have_a_device_and_those_of_edges_are_there_once() -> None:
    text = """# HELP tigas_render_requests_total Render requests
# TYPE tigas_render_requests_total counter
tigas_render_requests_total{outcome="frame"} 3.0
# HELP tigas_render_frame_seconds Time
# TYPE tigas_render_frame_seconds histogram
tigas_render_frame_seconds_bucket{le="+Inf",stage="queue"} 3.0
tigas_render_frame_seconds_count{stage="queue"} 3.0
tigas_render_frame_seconds_sum{stage="queue"} 0.5
# HELP tigas_render_viewers Viewers
# TYPE tigas_render_viewers gauge
tigas_render_viewers{edge="0"} 2.0
"""
    merged = aggregate.merge_metrics({"a": text.encode(), "b": text.encode()}, []).decode()
    for device in "ab":
        assert f'tigas_render_requests_total{{device="{device}",outcome="frame"}} 3.0' in merged
        assert f'tigas_render_frame_seconds_bucket{{device="{device}",le="+Inf",stage="queue"}} 3.0' in merged
    assert merged.count("tigas_render_viewers{") == 1
    assert merged.count("# TYPE tigas_render_frame_seconds histogram") == 1
