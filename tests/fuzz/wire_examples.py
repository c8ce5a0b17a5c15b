"""Every type that a service reads from the wire, with instances that it accepts."""

from __future__ import annotations

import json
from typing import Any

from tests.dash.conftest import pose, session_request
from tests.experiments.made_up import STREAM, configuration, frame, inputs, recording, reply, sampled
from tests.experiments.store.conftest import plan, upload
from tests.render.fakes import render_request
from tigas_common.wire.dash import PoseUpdate, SessionRequest
from tigas_common.wire.render import RenderRequest, SceneEdit
from tigas_common.wire.shaper import LinkSetting, LoopRequest, SeekRequest, StartRequest
from tigas_experiments.wire.recording import Recording, Sample
from tigas_experiments.wire.run import Configuration
from tigas_experiments.wire.store import ExperimentRequest, NextRequest, RunUpload, SampleIndex
from tigas_render.scenes.source import SceneMetadata

EULER = render_request().model_dump(mode="json", exclude_none=True)
QUATERNION = {name: EULER[name] for name in ("scene", "fx", "fy", "cx", "cy", "width", "height")} | {
    "position": [0, 0, 0],
    "quaternion": [0, 0, 0, 1],
    "profile": 3,
    "overscan": 0.15,
    "depth": True,
    "detail": "full",
    "deadline_ms": 50,
    "format": "png",
}
POSE = {"position": [0, 0, 0], "quaternion": [0, 0, 0, 1]}
KEYFRAMES = [POSE | {"t_ms": 0}, POSE | {"t_ms": 1000}]
SHORT = {
    "inputs": [entry.model_dump(mode="json") for entry in inputs(2)],
    "frames": [frame(10.0, 1).model_dump(mode="json")],
    "replies": [reply(0.0, 10.0).model_dump(mode="json")],
    "requests": [{"at": 0.0, "pose": 1, "asked_rung": 2, "fate": "shown"}],
    "captures": [{"at": 500.0, "shown_at": 490.0, "pose": 1, "rung": None, "width": 64, "height": 36}],
    "dash": STREAM.model_dump(mode="json"),
}
"""Lists of a recording, with few entries."""
RUN_UPLOAD = {**upload(), "recording": recording(**SHORT)}
SAMPLE = sampled(7).model_dump(mode="json", exclude_none=True) | {"rung": 2}
TRACE_RUN = {"trace": "4g-bus", "rtt_ms": 40.0, "offset_s": 3.0}

EXAMPLES: dict[Any, list[Any]] = {
    RenderRequest: [EULER, QUATERNION],
    SessionRequest: [session_request(), session_request(representations=None, frame_rate=60)],
    PoseUpdate: [json.loads(pose(1, 50)), json.loads(pose(2, 50)) | {"fx": 100.0, "fy": 100.0, "cx": 1.0, "cy": 0.0}],
    LinkSetting: [{"down_kbps": 1, "up_kbps": 1}, {"down_kbps": 0, "up_kbps": 9, "delay_ms": 1, "loss_pct": 0.5}],
    StartRequest: [{"trace": "steps"}, {"trace": "steps", "loop": False, "delay_ms": 20}],
    SeekRequest: [{"position_ms": 100}],
    LoopRequest: [{"loop": True}],
    ExperimentRequest: [
        plan(),
        {"file": 'name = "x"', "movements": {"walk.csv": "t_ms,x"}, "traces_s": {"4g-bus": 30.0}},
    ],
    NextRequest: [{"page": "a"}, {"page": "b", "begin": True, "allow_changes": True}],
    Configuration: [
        configuration().model_dump(mode="json"),
        configuration(profile=2, network=TRACE_RUN).model_dump(mode="json"),
    ],
    Recording: [RUN_UPLOAD["recording"]],
    RunUpload: [RUN_UPLOAD, {"problem": "The connection was lost."}],
    Sample: [SAMPLE],
    SampleIndex: [{"samples": [SAMPLE]}],
    SceneMetadata: [
        {},
        {"name": "A wall", "camera": {"position": [0, 0, 0], "look_at": [0, 0, 3]}, "background": [0, 0, 1]},
        {"up": [0, 1e-9, 1], "background": [1, 1, 0.5]},
        {"views": {"Door": POSE}, "paths": {"Tour": {"keyframes": KEYFRAMES, "easing": "ease-in", "loop": True}}},
    ],
    SceneEdit: [
        {"camera": {"position": [0, 0, 0], "look_at": [0, 0, 3]}, "up": [0, 1, 0]},
        {"views": {"Door": POSE, "Window": None}, "paths": {"Tour": {"keyframes": KEYFRAMES}, "Old tour": None}},
    ],
}
