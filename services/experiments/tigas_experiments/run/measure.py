"""One run of a command: takes a configuration and produces a folder of records."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from pydantic import ValidationError

from tigas_common.errors import StartError
from tigas_experiments.errors import RunFailed
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import RunRecord, RunWriter
from tigas_experiments.records.load import monitor_load
from tigas_experiments.records.samples import write_sample_file, write_samples
from tigas_experiments.run.browser import Viewer, open_viewer
from tigas_experiments.run.environment import Environment, RunSetup
from tigas_experiments.run.job import complete, page_settings, run_plan, write_records
from tigas_experiments.run.link import link_sample, record_link, reserve_link
from tigas_experiments.run.targets import find_fault
from tigas_experiments.run.watched import find_watched
from tigas_experiments.wire.recording import Recording
from tigas_experiments.wire.run import Configuration
from tigas_experiments.wire.store import RunUpload

DRAIN_S = 30
"""Seconds that a recording may take beyond its movement."""


async def measure_run(
    environment: Environment, configuration: Configuration, folder: Path, stage: Callable[[str], None]
) -> RunRecord:
    """Make one run, write its folder, and return its record. A failed run is marked and does not raise.

    `stage` receives the current step. A cancelled run is also marked. On a full disk marking may fail: a run with a
    missing run.json, or one that says "running", counts as incomplete.
    """
    record = RunRecord(
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
    except ValidationError as error:
        return failed(f"The recording is not valid: {error.errors()[0]['msg']}.")
    except OSError as error:
        return failed(f"The run could not be written: {error}")
    except BaseException:
        failed("The run was stopped before it ended.")
        raise


async def _measure(
    setup: RunSetup, configuration: Configuration, writer: RunWriter, stage: Callable[[str], None]
) -> RunRecord:
    stage("opening the viewer")
    url, scene = setup.target.url, configuration.scene
    plan = run_plan(configuration, setup.points)
    async with open_viewer(setup.browser, url, scene, configuration.width, configuration.height) as page:
        async with reserve_link(setup.target, setup.network, configuration.warm_up_s) as link:
            await page.prepare(page_settings(configuration), setup.points[0])
            stage("warms up")
            if link is not None:
                await link.warm_up()
            await asyncio.sleep(configuration.warm_up_s)
            stage("measures")
            watch = await asyncio.to_thread(find_watched, setup.target)
            async with monitor_load(url, processes=watch.processes) as load:
                if link is not None:
                    await link.play()
                async with record_link(link) as seen:
                    recording = await page.record(plan, patience_s=configuration.duration_s + DRAIN_S)
                    await page.check()
        start = recording.started_unix_ms
        # A page that no longer receives frames still plays to the end.
        problem = await find_fault(setup.target)
        sampled = configuration.sample_stride > 0
        upload = RunUpload(
            problem=problem,
            recording=recording,
            link=tuple(link_sample(status, at - start) for at, status in seen),
            backend=seen[-1][1].backend if seen else None,
            sampling_problem=None if problem else await _keep_pictures(page, recording, writer, sampled=sampled),
        )
    record = write_records(
        writer, upload, load, setup.made_from, browser=setup.browser.version, services=watch.services
    )
    if record.status == "failed":
        return record
    stage("comparing with ground truth")
    return await complete(writer.folder, url)


async def _keep_pictures(page: Viewer, recording: Recording, writer: RunWriter, *, sampled: bool) -> str | None:
    """Fetch the page's captures and samples one by one. Returns the reason for missing samples."""
    for index in range(len(recording.captures)):
        writer.capture(index, await page.capture(index))
    if not sampled:
        return None
    told = await page.samples()
    for name in told.pictures:
        seq, _, kind = name.partition(".")
        write_sample_file(writer.folder, int(seq), kind, await page.sample_picture(name))
    if told.samples:
        write_samples(writer.folder, told.samples)
    return told.problem
