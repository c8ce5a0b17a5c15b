"""One run: a configuration in, a folder of records out. Comparisons and experiments are lists of these."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx

from tigas_common.errors import StartError
from tigas_experiments.errors import RunFailed
from tigas_experiments.movement.trace import TimedPose
from tigas_experiments.quality.ground_truth import TIMEOUT_S, GroundTruth, pose_at
from tigas_experiments.quality.picture import BrokenPicture, CaptureQuality, encode
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import RunRecord, RunWriter, Snapshot
from tigas_experiments.records.load import Load, watching_load
from tigas_experiments.records.machine import Server
from tigas_experiments.run.browser import Viewer, viewer
from tigas_experiments.run.environment import Environment, Setup
from tigas_experiments.run.inputs import points_sha256
from tigas_experiments.run.link import held, link_sample, watching_link
from tigas_experiments.run.targets import alive
from tigas_experiments.run.watched import watched
from tigas_experiments.wire.recording import Recording
from tigas_experiments.wire.run import OFF, Configuration

DRAIN_S = 30
"""How much longer than its movement a recording may take."""


async def run(
    environment: Environment, configuration: Configuration, folder: Path, stage: Callable[[str], None]
) -> RunRecord:
    """Make one run, write its folder, and return its record. A failed run is marked, and does not raise.

    `stage` receives the current step. A cancelled run is also marked. On a full disk marking may fail: a run whose
    run.json says "running" or is missing counts as incomplete.
    """
    record = RunRecord(
        status="running",
        problem=None,
        configuration=configuration,
        machine=environment.machine,
        started=datetime.now(UTC).isoformat(timespec="seconds"),
    )
    writer: RunWriter | None = None

    def failed(problem: str) -> RunRecord:
        with contextlib.suppress(OSError):
            if writer is not None:
                return writer.close(status="failed", problem=problem)
        return record.model_copy(update={"status": "failed", "problem": problem})

    try:
        writer = RunWriter(folder, record)
        stage("prepares")
        return await _measure(await environment.setup(configuration), configuration, writer, stage)
    except (StartError, RunFailed, BrokenRecording) as error:
        return failed(str(error))
    except OSError as error:
        return failed(f"The run could not be written: {error}")
    except BaseException:
        failed("The run was stopped before its end.")
        raise


async def _measure(
    setup: Setup, configuration: Configuration, writer: RunWriter, stage: Callable[[str], None]
) -> RunRecord:
    stage("opens the viewer")
    url = setup.target.url
    async with viewer(setup.browser, url, setup.scene.id, configuration.width, configuration.height) as page:
        async with held(setup.target, setup.network) as link:
            await page.prepare(page_settings(configuration), setup.points[0])
            stage("warms up")
            await asyncio.sleep(configuration.warm_up_s)
            stage("measures")
            watch = await asyncio.to_thread(watched, setup.target)
            async with watching_load(processes=watch.processes) as load, watching_link(link) as seen:
                if link is not None:
                    await link.play()
                recording = await recorded(page, configuration, setup.points)
                await page.check()
        writer.recording(recording)
        if not await alive(setup.target):  # a page that no longer receives frames still plays to the end
            raise RunFailed("A service ended, or was started again, during the run.")
        start = recording.started_unix_ms
        during = [sample for sample in load if 0 <= sample.unix_ms - start <= recording.ended_ms]
        writer.link_and_load([link_sample(status, at - start) for at, status in seen], during)
        problem = await _keep_samples(page, writer) if configuration.sample_stride else None
        stage("compares with ground truth")
        writer.quality(await _assess(page, url, recording, writer, predicted=configuration.prediction != OFF))
        return writer.close(
            status="complete" if recording.complete else "failed",
            problem=None if recording.complete else "The movement was not played to its end.",
            browser=setup.browser.version,
            backend=seen[-1][1].backend if seen else None,
            inputs_sha256=setup.digests,
            server=Server.of(setup.target.config, setup.scene),
            sampling_problem=problem,
            scene_bytes=setup.scene.file_bytes,
            scene_sha256=setup.scene.file_sha256,
            points_sha256=points_sha256(setup.points),
            load=Load.of(during, watch.services),
            recording=recording.head,
        )


def page_settings(configuration: Configuration) -> dict[str, Any]:
    """The viewer's settings before a run: everything that is not said here has its default."""
    mode, profile = configuration.mode, configuration.profile
    chosen: dict[str, Any]
    if configuration.local:
        chosen = {"mode": "stateless"}  # the recording includes its download
    elif mode == "webrtc":
        chosen = {"mode": "webrtc", "webrtcStream": "h264-30"}
    elif configuration.streamed:
        preset = mode.removeprefix("dash-")
        representation = configuration.dash_representation
        chosen = {
            "mode": "dash",
            "dashPreset": preset,
            "dashFrameRate": configuration.dash_frame_rate,
            "dashRepresentation": None if representation is None else representation.model_dump(),
        }
    elif isinstance(profile, int):
        chosen = {"mode": mode, "controller": "fixed", "profile": profile}
    else:
        chosen = {"mode": mode, "controller": profile}
    # Nothing next to the picture, so that the stage is the viewport; no second request for a view that stands
    # still; one
    # format, so that a rung is the same picture on every link.
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


async def recorded(page: Viewer, configuration: Configuration, points: Sequence[TimedPose]) -> Recording:
    """Play a run's movement in a page that is prepared for it. Raises RunFailed and BrokenRecording."""
    duration_ms = configuration.duration_s * 1000
    plan = {
        "points": points,
        "duration_ms": duration_ms,
        "capture_every_ms": configuration.capture_every_ms,
        "sample_stride": configuration.sample_stride,
        "download": configuration.local,
    }
    return await page.record(plan, patience_s=configuration.duration_s + DRAIN_S)


async def _keep_samples(page: Viewer, writer: RunWriter) -> str | None:
    """Fetch the page's samples picture by picture; returns the reason for missing ones."""
    told = await page.samples()
    for name in told.pictures:
        seq, _, kind = name.partition(".")
        writer.sample_picture(int(seq), kind, await page.sample_picture(name))
    if told.samples:
        writer.samples(told.samples)
    return told.problem


async def _assess(
    page: Viewer, url: str, recording: Recording, writer: RunWriter, *, predicted: bool
) -> list[CaptureQuality]:
    """Fetch the kept pictures one by one and compare them."""
    assessed: list[CaptureQuality] = []
    async with httpx.AsyncClient(base_url=url, timeout=TIMEOUT_S, trust_env=False, verify=False) as http:
        truth = GroundTruth(http, recording.scene, recording.lens)
        for index, capture in enumerate(recording.captures):
            png = await page.capture(index)
            writer.capture(index, png)
            try:
                quality = await truth.assess(png, capture, recording.inputs, predicted=predicted)
            except BrokenPicture as error:
                raise RunFailed(f"Picture {index} of the run cannot be compared: {error}") from None
            if quality is not None:
                assessed.append(quality)
            if index == len(recording.captures) // 2 and (current := pose_at(recording.inputs, capture.at)):
                writer.snapshot(Snapshot(at=capture.at, capture=index), encode(await truth.picture(current)))
    return assessed
