"""The lab's runs that the simulator is compared with, and what each rung takes alone on the machine."""

from __future__ import annotations

import json
import shutil
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
from prometheus_client.parser import text_string_to_metric_families

from tigas_common.errors import TigasError
from tigas_common.wire.recording import Input, Lens
from tigas_common.wire.render import DEFAULT_LADDER, RenderRequest
from tigas_common.wire.run import Configuration
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.run.environment import open_environment
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.run.measure import run
from tigas_experiments.run.targets import LAB_URL

VIEW_EVERY_MS = 500
SCENE = "courtyard"
STAGES = ("queue", "render", "encode")


@dataclass(frozen=True, slots=True)
class Server:
    """What the render service counted while a run was made."""

    frames: float
    seconds: dict[str, float]
    """Of all frames together, by stage."""

    @classmethod
    async def read(cls) -> Server:
        """Until now."""
        async with httpx.AsyncClient(base_url=LAB_URL, trust_env=False) as http:
            text = (await http.get("/metrics")).text
        samples = [sample for family in text_string_to_metric_families(text) for sample in family.samples]
        seconds = dict.fromkeys(STAGES, 0.0)
        frames = 0.0
        for sample in samples:
            if sample.name == "tigas_render_frame_seconds_sum":
                seconds[sample.labels["stage"]] = sample.value
            if sample.name == "tigas_render_frame_seconds_count":
                frames = sample.value
        return cls(frames, seconds)

    def since(self, before: Server) -> dict[str, float]:
        """Frames, and milliseconds of the mean one."""
        frames = self.frames - before.frames
        spent = {stage: 1000 * (self.seconds[stage] - before.seconds[stage]) / max(1, frames) for stage in STAGES}
        return {"frames": frames, **spent}


@dataclass(frozen=True, slots=True)
class Plan:
    """All runs, and where they go."""

    runs: Sequence[Configuration]
    fast: Sequence[Configuration]
    """Over the fast link, one for each rung."""
    out: Path

    def folder(self, configuration: Configuration) -> Path:
        """Of one run."""
        return self.out / "runs" / configuration.slug

    @property
    def missing(self) -> list[Configuration]:
        """The runs that are to be made."""
        return [one for one in (*self.runs, *self.fast) if not self.complete(one)]

    def complete(self, configuration: Configuration) -> bool:
        """Whether it was made."""
        return (self.folder(configuration) / "server.json").exists()

    @property
    def views(self) -> Path:
        """What each rung takes, alone on the machine."""
        return self.out / "views.json"


async def measure(plan: Plan, most: int) -> None:
    """Make the runs that are missing, at most so many."""
    if not plan.missing and plan.views.exists():
        return
    async with open_environment(None, None, None, Inputs(Path()), ladder="paper") as environment:
        await environment.check(plan.runs)
        for configuration in plan.missing[:most]:
            folder = plan.folder(configuration)
            shutil.rmtree(folder, ignore_errors=True)
            print(f"{folder.name} …", flush=True)
            before = await Server.read()
            record = await run(environment, configuration, folder, lambda _: None)
            if record.status != "complete":
                raise TigasError(f"{folder.name}: {record.problem}")
            (folder / "server.json").write_text(json.dumps((await Server.read()).since(before)))
        if not plan.missing and not plan.views.exists():
            plan.views.write_text(json.dumps(await measure_views(StoredRun(plan.folder(plan.runs[0])))))


async def measure_views(stored: StoredRun) -> dict[str, Any]:
    """Each rung along the movement, one frame after another: bytes, and the server's milliseconds."""
    assert stored.record.recording is not None
    lens = stored.record.recording.lens
    inputs = stored.inputs()
    poses = [next(pose for pose in inputs if pose.at >= at) for at in range(0, int(inputs[-1].at), VIEW_EVERY_MS)]
    print(f"{len(poses)} views at each rung …", flush=True)
    async with httpx.AsyncClient(base_url=LAB_URL, trust_env=False, timeout=30) as http:
        frames = [
            [await render(http, pose, lens, rung) for rung in range(len(DEFAULT_LADDER))] for pose in [poses[0], *poses]
        ][1:]  # the first ones warm it up
    return {
        "rungs": [
            {
                "render_ms": statistics.mean(timing["render"] for _, timing in of_rung),
                "encode_ms": statistics.mean(timing["encode"] for _, timing in of_rung),
            }
            for of_rung in zip(*frames, strict=True)
        ],
        "views": [
            {"t_ms": max(0.0, pose.at), "bytes": [len(image) for image, _ in rungs]}
            for pose, rungs in zip(poses, frames, strict=True)
        ],
    }


async def render(http: httpx.AsyncClient, pose: Input, lens: Lens, rung: int) -> tuple[bytes, dict[str, float]]:
    """One JPEG, and where the server's milliseconds went."""
    request = RenderRequest.at(SCENE, pose.camera, lens.intrinsics, profile=rung)
    answer = await http.post("/render", content=request.model_dump_json(exclude_none=True))
    answer.raise_for_status()
    timing = dict(part.strip().split(";dur=") for part in answer.headers["Server-Timing"].split(","))
    return answer.content, {stage: float(value) for stage, value in timing.items()}
