"""Ground truth of a run's captures, rendered again: the viewer's correct view at each capture."""

from __future__ import annotations

import asyncio
from pathlib import Path

from tigas_common.files import read_regular
from tigas_common.render_requests import RenderClient, RenderProblem
from tigas_common.wire.render import RenderRequest
from tigas_experiments.quality.ground_truth import input_at
from tigas_experiments.quality.picture import BrokenPicture, CaptureQuality, compare, decode, decode_screen
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import StoredRun, capture_path
from tigas_experiments.records.samples import MAX_PICTURE_BYTES, TRUTH
from tigas_experiments.samples.rerender import OnProgress, changed_scene, run_concurrently
from tigas_experiments.wire.recording import Capture, Input, RecordingHead

SAME_DB = 0.5
"""Tolerated deviation of the PSNR from the run: rounding stays below it, another scene exceeds it."""


async def render_truth(
    run: Path, renderer: RenderClient, on_progress: OnProgress = lambda done, total: None
) -> str | None:
    """Render missing ground truth. Returns the reason for any remaining gaps, in one sentence.

    Raises RenderUnavailable and OSError.
    """
    try:
        stored = StoredRun(run)
        head, inputs = stored.record.recording, stored.read(Input)
        known = {entry.at: entry for entry in stored.read(CaptureQuality)}
        missing = [
            (index, capture, known[capture.at])
            for index, capture in enumerate(stored.read(Capture))
            if capture.at in known and not capture_path(run, index, TRUTH).exists()
        ]
        if head is None or not missing:
            return None
        scene = await renderer.load(head.scene)
    except (BrokenRecording, RenderProblem) as error:
        return str(error)
    if (changed := changed_scene(stored.record, scene.file_sha256)) is not None:
        return changed
    problems: list[str] = []
    done = 0

    async def work(one: tuple[int, Capture, CaptureQuality]) -> None:
        nonlocal done
        try:
            await _keep(run, renderer, head, inputs, *one)
        except (RenderProblem, BrokenPicture) as error:
            problems.append(f"Picture {one[0]}: {error}")
        done += 1
        on_progress(done, len(missing))

    await run_concurrently(missing, work)
    return " ".join(problems[:1]) or None


async def _keep(
    run: Path,
    renderer: RenderClient,
    head: RecordingHead,
    inputs: list[Input],
    index: int,
    capture: Capture,
    quality: CaptureQuality,
) -> None:
    """Store one ground truth if it matches the run's comparison. Raises BrokenPicture, RenderProblem and OSError."""
    pose = input_at(inputs, capture.at)
    if pose is None:
        return
    request = RenderRequest.at(head.scene, pose.camera, head.lens.intrinsics, format="png")
    truth = await renderer.frame(request)
    await asyncio.to_thread(_check, read_regular(capture_path(run, index), MAX_PICTURE_BYTES), truth, quality)
    new = capture_path(run, index, f"{TRUTH}.new")
    new.write_bytes(truth)
    new.replace(capture_path(run, index, TRUTH))


def _check(picture: bytes, truth: bytes, quality: CaptureQuality) -> None:
    found = compare(decode_screen(picture)[0], decode(truth))
    if quality.seen is not None and abs(found.psnr_db - quality.seen.psnr_db) > SAME_DB:
        raise BrokenPicture(
            f"the renderer answers differently now: the picture was {quality.seen.psnr_db:.1f} dB from ground truth in "
            f"the run, and is {found.psnr_db:.1f} dB from what is rendered now."
        )
