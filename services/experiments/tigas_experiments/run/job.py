"""A run as performed by the page: its settings and movement, and the processing of its recording.

Runs made by a command and runs uploaded by a page have the same folder format.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tigas_common.render_requests import RenderClient
from tigas_common.wire.render import SceneInfo, ServerConfig
from tigas_experiments.errors import RunFailed
from tigas_experiments.quality.ground_truth import GroundTruth, input_at
from tigas_experiments.quality.picture import BrokenPicture, CaptureQuality, encode
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import InputDigests, RunRecord, RunWriter, Snapshot, StoredRun, capture_path
from tigas_experiments.records.load import Load, LoadSample, WatchedServices
from tigas_experiments.records.machine import Server
from tigas_experiments.records.samples import read_sample_file
from tigas_experiments.wire.movement import TimedPose
from tigas_experiments.wire.recording import Capture, Input, LinkSample, Recording
from tigas_experiments.wire.run import OFF, Configuration, RunPlan
from tigas_experiments.wire.store import RunUpload

NOT_PLAYED = "The movement was not played to its end."
HIDDEN = "The page was hidden during the run."
NO_FRAME = "No frame arrived during the run."


def page_settings(configuration: Configuration) -> dict[str, Any]:
    """The viewer's settings before a run; settings not listed have their defaults."""
    mode, profile = configuration.mode, configuration.profile
    chosen: dict[str, Any]
    if configuration.local:
        # The mode is switched when the recording begins, so that it includes the download.
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
    # No sidebar, so that the stage is the viewport; no second request for a view at rest; one image format, so that a
    # rung is the same picture on every link.
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
    """The run for the page to play, with its movement in the scene's own frame."""
    return RunPlan(
        points=tuple(points),
        duration_ms=configuration.duration_s * 1000,
        capture_every_ms=configuration.capture_every_ms,
        sample_stride=configuration.sample_stride,
        download=configuration.local,
    )


@dataclass(frozen=True, slots=True)
class RunSources:
    """Inputs and services of a run."""

    digests: InputDigests
    points_sha256: str
    config: ServerConfig
    scene: SceneInfo

    @property
    def fields(self) -> dict[str, Any]:
        return {
            "inputs_sha256": self.digests,
            "points_sha256": self.points_sha256,
            "server": Server.from_config(self.config, self.scene),
            "scene_bytes": self.scene.file_bytes,
            "scene_sha256": self.scene.file_sha256,
        }


def write_records(
    writer: RunWriter,
    upload: RunUpload,
    load: Sequence[LoadSample],
    made_from: RunSources,
    *,
    browser: str | None,
    services: WatchedServices | None = None,
) -> RunRecord:
    """Write all records except pictures. The run remains incomplete unless it failed. Raises OSError."""
    recording = upload.recording
    if recording is None:
        return writer.close(status="failed", problem=upload.problem, **made_from.fields)
    during = [sample for sample in load if 0 <= sample.unix_ms - recording.started_unix_ms <= recording.ended_ms]
    writer.recording(recording)
    writer.write(LinkSample, upload.link)
    writer.write(LoadSample, during)
    writer.write(CaptureQuality, ())
    problem = upload.problem or _problem(recording, writer.configuration)
    return writer.close(
        status="running" if problem is None else "failed",
        problem=problem,
        browser=browser,
        backend=upload.backend,
        sampling_problem=upload.sampling_problem,
        load=Load.summarise(during, services),
        recording=recording.head,
        **made_from.fields,
    )


async def complete(folder: Path, render: str) -> RunRecord:
    """Compare a run's captures, all of which must exist, with ground truth, and mark the run as complete.

    Raises RunFailed, BrokenRecording and OSError.
    """
    run = StoredRun(folder)
    writer = RunWriter.resume(run)
    head, captures, inputs = run.record.recording, run.read(Capture), run.read(Input)
    if head is None:
        raise BrokenRecording(f"{folder / 'run.json'} does not describe the recording.")
    predicted = run.record.configuration.prediction != OFF
    assessed: list[CaptureQuality] = []
    async with RenderClient.connect(render) as renderer:
        truth = GroundTruth(renderer, head.scene, head.lens)
        for index, capture in enumerate(captures):
            png = read_sample_file(capture_path(folder, index))
            try:
                quality = await truth.assess(png, capture, inputs, predicted=predicted)
            except BrokenPicture as error:
                raise RunFailed(f"Picture {index} of the run cannot be compared: {error}") from None
            if quality is not None:
                assessed.append(quality)
            if index == len(captures) // 2 and (current := input_at(inputs, capture.at)):
                writer.snapshot(Snapshot(at=capture.at, capture=index), encode(await truth.picture(current)))
    writer.write(CaptureQuality, assessed)
    return writer.close(status="complete")


def _problem(recording: Recording, configuration: Configuration) -> str | None:
    if not recording.complete:
        return HIDDEN if recording.hidden else NOT_PLAYED
    if configuration.over_h3 and (stream := recording.dash) is not None and set(stream.protocols) != {"h3"}:
        return f"Segments came over {' and '.join(stream.protocols) or 'nothing known'} instead of HTTP/3."
    # A scene that did not arrive in time is a valid result.
    return NO_FRAME if not recording.frames and recording.mode != "local" else None
