"""`tigas experiment run` as a person uses it: in a real browser, which is killed, against real services."""

from __future__ import annotations

import json
import os
import signal
import statistics
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.experiments.conftest import Services
from tests.experiments.processes import finished, started, until
from tests.experiments.run.test_plan import toml
from tigas_experiments.quality.picture import CaptureQuality
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.summary import summarise
from tigas_experiments.report.run_table import load_results
from tigas_experiments.wire.recording import Input, ShownFrame
from tigas_experiments.wire.run import DASH


def run(url: str, file: Path, **fields: Any) -> subprocess.Popen[str]:
    """Start it, with short runs of these fields; its folder is next to the file."""
    short = {"scenes": ["pebbles"], "duration_s": 2, "warm_up_s": 0.5, "viewport": "320x180", "shuffled": False}
    file.write_text(toml(**{**short, "networks": ["unshaped"], "controllers": [3], **fields}))
    return started("experiment", "run", str(file), "--out", str(file.parent / "out"), "--url", url)


def report(out: Path) -> list[dict[str, Any]]:
    """The runs, in the order in which they were made."""
    return [summarise(run.folder).model_dump(mode="json") for run in load_results(out).made]


def told_by_the_page(run: StoredRun) -> float:
    """The median of the latencies that the page itself took for its frames'."""
    first = run.read(Input)[0].pose
    return statistics.median(latency for f in run.read(ShownFrame) if f.pose >= first for latency in f.latencies)


def records(file: Path) -> list[dict[str, Any]]:
    """All run.json, in the order in which the runs were begun."""
    paths = (file.parent / "out" / "runs").glob("*/run.json")
    return sorted((json.loads(path.read_text()) for path in paths), key=lambda record: record["started"])


def kill_the_browser(process: subprocess.Popen[str]) -> None:
    """Like a user's interruption, or a system out of memory."""
    for child in psutil.Process(process.pid).children(recursive=True):
        if "chrom" in child.name() and not any(part.startswith("--type=") for part in child.cmdline()):
            os.kill(child.pid, 9)
            return
    raise AssertionError("no browser")


@pytest.mark.slow
@pytest.mark.extended
def test_a_browser_that_is_killed_costs_one_run_and_resume_repeats_just_that(
    services: Services, tmp_path: Path
) -> None:
    file = tmp_path / "small.toml"
    fields: dict[str, Any] = {"controllers": ["latency", 2, 3], "networks": ["20mbit,20ms-rtt"]}
    before = len(services.shaper.asked)
    process = run(services.url, file, **fields)
    # Held once to try it, and by each run once its page is open.
    until(process, lambda: [path for path, _ in services.shaper.asked[before:]].count("/link") == 3, "no second run")
    kill_the_browser(process)
    status, output, errors = finished(process)
    assert status == 1, errors
    assert "1 of 3 runs are incomplete" in errors
    first, second, third = records(file)
    assert [run["status"] for run in (first, second, third)] == ["complete", "failed", "complete"]
    assert second["problem"]
    assert errors.count(second["problem"]) == 1, "it is said"

    status, output, errors = finished(run(services.url, file, **fields))
    assert status == 0, errors
    assert "All 3 runs are complete." in errors
    assert "The report: " in output
    assert (file.parent / "out" / "report.html").is_file()
    again = records(file)
    assert again[:2] == [first, third], "complete runs stay as they are"
    assert again[2]["configuration"] == second["configuration"]
    assert {run["status"] for run in again} == {"complete"}
    assert len({run["points_sha256"] for run in again}) == 1, "all were given the same movement"
    assert again[0]["points_sha256"]


@pytest.mark.slow
@pytest.mark.extended
def test_every_mode_is_measured_over_the_same_link_and_movement(services: Services, out: Path) -> None:
    asked = len(services.shaper.asked)
    fields = {"networks": ["20mbit,20ms-rtt"], "modes": ["stateless", *DASH], "capture_every_s": 0.5}
    status, output, errors = finished(run(services.url, out.with_suffix(".toml"), **fields))
    assert status == 0, errors
    assert "within 108 ms" in output
    link = {"down_kbps": 20_000, "up_kbps": 10_000, "delay_ms": 10, "jitter_ms": 0, "loss_pct": 0}
    assert services.shaper.asked[asked:] == [("/link", link), ("/stop", {})] * 5, "once before the first of four runs"
    runs = report(out)
    assert [made["record"]["configuration"]["mode"] for made in runs] == ["stateless", *DASH]
    for made in runs:
        figures = made["figures"]["values"]
        assert figures["inputs"] > 30, "the browser sampled the movement"
        assert figures["inputs_unanswered"] == 0
        assert 0 < figures["motion_to_photon_p50_ms"] <= figures["motion_to_photon_p95_ms"]
        assert figures["new_views_per_s"] > 2.5
        assert figures["received_mbit_s"] > 0.01
        assert figures["link_mbit_s"] == 20
        assert len(StoredRun(out / "runs" / made["folder"]).read(CaptureQuality)) == 4, "two a second"
        assert figures["picture_ssim"] > 0.5
        assert figures["picture_psnr_db"] > figures["view_psnr_db"], "lateness costs"
        assert figures["picture_psnr_db"] > figures["seen_psnr_db"]
        assert figures["content_age_p95_ms"] > figures["content_age_mean_ms"] > 10
        assert made["record"]["load"]["processors"] == psutil.cpu_count()
        assert made["record"]["load"]["render_busy_share"] is not None
    streams = [made["record"]["recording"]["dash"] for made in runs]
    assert streams[0] is None
    assert [one["target_latency_ms"] for one in streams[1:]] == [1000, 120, 60]
    assert [one["player"].split()[0] for one in streams[1:]] == ["dash.js", "dash.js", "bare"]
    for stream in streams[1:]:
        assert min(stream["targets_ms"]) >= stream["target_latency_ms"], "what was in force"
        assert stream["representations"]
        assert all(one["bitrate_kbps"] > 100 and one["codecs"].startswith("avc1.") for one in stream["representations"])
        cited = f"{stream['player']} over http/1.1; 30 frames/s"
        assert cited in (out / "report.html").read_text(), "what can be cited"
    first, *others = (made["figures"]["values"] for made in runs)
    assert first["requests_sent"] >= first["requests_shown"] > 5
    assert not any("requests_sent" in other for other in others), "a stream has no requests of its own"
    stateless, typical, *_ = (made["figures"]["values"]["motion_to_photon_p50_ms"] for made in runs)
    assert typical > 500 > stateless, "a stream that aims at a second's latency has about that"
    stored = [StoredRun(out / "runs" / made["folder"]) for made in runs]
    for made, records in zip(runs, stored, strict=True):
        latency_ms = made["figures"]["values"]["motion_to_photon_p50_ms"]
        assert latency_ms == pytest.approx(told_by_the_page(records), abs=20)
    ends = [records.read(Input)[-1].position for records in stored]
    for end in ends[1:]:
        assert ends[0] == pytest.approx(end, abs=1e-6)
    assert list((out / "runs" / runs[0]["folder"] / "captures").glob("*.png"))
    assert (out / "report.html").stat().st_size > 50_000


@pytest.mark.slow
@pytest.mark.extended
def test_a_stream_may_have_a_single_representation(services: Services, out: Path) -> None:
    fields = {"modes": ["dash-tuned", "dash-edge"], "dash_representations": ["r3-300"]}
    status, _, errors = finished(run(services.url, out.with_suffix(".toml"), **fields))
    assert status == 0, errors
    runs = report(out)
    assert [made["folder"].split("_")[3] for made in runs] == ["dash-tuned-r3-300", "dash-edge-r3-300"]
    for made in runs:
        assert [one["id"] for one in made["record"]["recording"]["dash"]["representations"]] == ["r3-300"]
        assert made["figures"]["values"]["new_views_per_s"] > 2.5
    assert "DASH, tuned, r3-300" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    "end_it",
    [
        pytest.param(lambda process: os.killpg(process.pid, signal.SIGINT), id="Ctrl+C", marks=pytest.mark.extended),
        pytest.param(subprocess.Popen.terminate, id="SIGTERM"),
    ],
)
@pytest.mark.slow
def test_who_ends_it_ends_everything_and_keeps_what_was_finished(
    services: Services, out: Path, end_it: Callable[[subprocess.Popen[str]], None]
) -> None:
    process = run(services.url, out.with_suffix(".toml"), controllers=[3, 2])
    until(process, lambda: len(list((out / "runs").glob("*"))) == 2, "the second run never began")
    children = psutil.Process(process.pid).children(recursive=True)
    end_it(process)
    status, _, _ = finished(process)
    assert status != 0
    _, alive = psutil.wait_procs(children, timeout=10)
    assert alive == []
    first, second = report(out)
    assert first["figures"]["values"]["inputs"] > 30
    assert second["figures"] is None
    assert second["problem"] == "The run was stopped before it ended."


def test_services_that_do_not_answer_get_one_sentence(out: Path) -> None:
    status, _, errors = finished(run("http://127.0.0.1:9", out.with_suffix(".toml")))
    assert status == 1
    assert "No TIGAS render service answers at http://127.0.0.1:9." in " ".join(errors.split())
    assert "Traceback" not in errors
    assert not out.exists()


def test_without_a_browser_it_says_what_to_install(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(out.parent))
    status, _, errors = finished(run("http://127.0.0.1:9", out.with_suffix(".toml")))
    assert status == 1
    assert "No Chromium or Chrome is installed: sudo apt-get install chromium" in errors
