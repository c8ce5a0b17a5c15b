"""`tigas compare` as a person uses it, in a real browser against real services."""

from __future__ import annotations

import os
import signal
import statistics
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.command import Result, tigas
from tests.experiments.conftest import Services
from tests.experiments.processes import finished, started, until
from tests.experiments.stub import Stub, fails
from tigas_experiments.records.folder import StoredRun, read_experiment
from tigas_experiments.records.summary import summarise
from tigas_experiments.report.run_table import load
from tigas_experiments.wire.recording import Input, ShownFrame
from tigas_experiments.wire.run import USUALLY_COMPARED

SHORT = ("--scene", "pebbles", "--duration", "2", "--viewport", "320x180", "--profile", "3")


def compare(*arguments: str) -> subprocess.Popen[str]:
    return started("compare", *arguments)


def report(out: Path) -> list[dict[str, Any]]:
    """The runs, in the order in which they were made."""
    return [summarise(run.folder).model_dump(mode="json") for run in load(out).made]


def told_by_the_page(run: StoredRun) -> float:
    """The median of the latencies that the page itself took for its frames'."""
    first = run.read(Input)[0].pose
    return statistics.median(latency for f in run.read(ShownFrame) if f.pose >= first for latency in f.latencies)


@pytest.mark.slow
@pytest.mark.extended
def test_every_mode_is_measured_over_the_same_link_and_movement(services: Services, out: Path) -> None:
    asked = len(services.shaper.asked)
    status, output, errors = finished(
        compare("--url", services.url, "--network", "20mbit,20ms-rtt", "--out", str(out), *SHORT)
    )
    assert status == 0, errors
    assert "within 108 ms" in output
    link = {"down_kbps": 20_000, "up_kbps": 10_000, "delay_ms": 10, "jitter_ms": 0, "loss_pct": 0}
    assert services.shaper.asked[asked:] == [("/link", link), ("/stop", {})] * 5, "once before the first of four runs"
    runs = report(out)
    assert [run["record"]["configuration"]["mode"] for run in runs] == list(USUALLY_COMPARED)
    for run in runs:
        figures = run["figures"]
        assert figures["latencies"]["inputs"] > 30, "the browser sampled the movement"
        assert figures["latencies"]["unanswered"] == 0
        assert 0 < figures["latencies"]["p50"] <= figures["latencies"]["p95"]
        assert figures["frames"]["new_views"] > 5
        assert figures["received_kbps"] > 10
        assert figures["target_kbps"] == 20_000
        assert figures["quality"]["pictures"] == 4, "two a second"
        assert figures["quality"]["picture_ssim"] > 0.5
        assert figures["quality"]["picture_psnr_db"] > figures["quality"]["view_psnr_db"], "lateness costs"
        assert figures["quality"]["picture_psnr_db"] > figures["quality"]["seen_psnr_db"]
        assert figures["content_ages"]["p95"] > figures["content_ages"]["mean"] > 10
        assert run["record"]["load"]["processors"] == psutil.cpu_count()
    streams = [run["record"]["recording"]["dash"] for run in runs]
    assert streams[0] is None
    assert [one["target_latency_ms"] for one in streams[1:]] == [1000, 120, 60]
    assert [one["player"].split()[0] for one in streams[1:]] == ["dash.js", "dash.js", "bare"]
    for stream in streams[1:]:
        assert min(stream["targets_ms"]) >= stream["target_latency_ms"], "what was in force"
        assert stream["representations"]
        assert all(one["bitrate_kbps"] > 100 and one["codecs"].startswith("avc1.") for one in stream["representations"])
        cited = f"{stream['player']} over http/1.1; 30 frames/s"
        assert cited in (out / "report.html").read_text(), "what can be cited"
    requests, *others = (run["figures"]["requests"] for run in runs)
    assert requests["sent"] >= requests["shown"] > 5
    assert others == [None] * 3, "a stream has no requests of its own"
    stateless, typical, *_ = (run["figures"]["latencies"]["p50"] for run in runs)
    assert typical > 500 > stateless, "a stream that aims at a second's latency has about that"
    stored = [StoredRun(out / "runs" / run["folder"]) for run in runs]
    for run, records in zip(runs, stored, strict=True):
        assert run["figures"]["latencies"]["p50"] == pytest.approx(told_by_the_page(records), abs=20)
    ends = [records.read(Input)[-1].position for records in stored]
    for end in ends[1:]:
        assert ends[0] == pytest.approx(end, abs=1e-6)
    assert list((out / "runs" / runs[0]["folder"] / "captures").glob("*.png"))
    assert (out / "report.html").stat().st_size > 50_000


@pytest.mark.slow
@pytest.mark.extended
def test_a_stream_may_have_a_single_representation(services: Services, out: Path) -> None:
    file = out.with_suffix(".toml")
    file.write_text(
        'name = "single"\nscenes = ["pebbles"]\nmovements = ["stroll"]\nnetworks = ["unshaped"]\n'
        'modes = ["dash-tuned", "dash-edge"]\ndash_representations = ["r3-300"]\n'
        'duration_s = 2\nwarm_up_s = 0.5\nviewport = "320x180"\nshuffled = false\n'
    )
    status, _, errors = finished(started("experiment", "run", str(file), "--url", services.url, "--out", str(out)))
    assert status == 0, errors
    runs = report(out)
    assert [run["folder"].split("_")[3] for run in runs] == ["dash-tuned-r3-300", "dash-edge-r3-300"]
    for run in runs:
        assert [one["id"] for one in run["record"]["recording"]["dash"]["representations"]] == ["r3-300"]
        assert run["figures"]["frames"]["new_views"] > 5
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
    modes = ("--modes", "stateless", "--profile", "2")
    process = compare("--url", services.url, "--network", "unshaped", *modes, "--out", str(out), *SHORT)
    until(process, lambda: len(list((out / "runs").glob("*"))) == 2, "the second run never began")
    children = psutil.Process(process.pid).children(recursive=True)
    end_it(process)
    status, _, _ = finished(process)
    assert status != 0
    _, alive = psutil.wait_procs(children, timeout=10)
    assert alive == []
    first, second = report(out)
    assert first["figures"]["latencies"]["inputs"] > 30
    assert second["figures"] is None
    assert second["problem"] == "The run was stopped before its end."


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (("--network", "no-such-trace"), "The shaper refused /start: "),
        (("--scene", "no-such-scene"), "The scene 'no-such-scene' cannot be loaded"),
        (("--profile", "magic"), "The controller 'magic' cannot be measured: The viewer failed"),
    ],
)
def test_what_cannot_be_had_is_said_before_anything_is_measured(
    services: Services, out: Path, wrong: tuple[str, str], sentence: str
) -> None:
    networks = ("--network", "unshaped")
    status, _, errors = finished(compare("--url", services.url, "--out", str(out), *networks, *SHORT, *wrong))
    assert status == 1
    assert sentence in " ".join(errors.split())
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--url", "http://127.0.0.1:9"), "No TIGAS render service answers at http://127.0.0.1:9."),
        (("--url", "nonsense"), "'nonsense' is no URL of a viewer"),
        (("--modes", "magic"), "modes.0: input should be"),
        (("--out", "."), ". already exists"),
    ],
)
def test_nonsense_gets_one_sentence(out: Path, arguments: tuple[str, str], sentence: str) -> None:
    status, _, errors = finished(compare("--url", "http://127.0.0.1:9", "--out", str(out), *arguments))
    assert status in (1, 2)
    assert sentence in " ".join(errors.replace("│", " ").split())
    assert "Traceback" not in errors
    assert not out.exists()


def tigas_compare(*arguments: str) -> Result:
    return tigas("compare", *arguments)


def test_its_options_are_the_plan_of_an_experiment(stub: Stub, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["/usr/bin/tigas", "compare", "--profile", "seen"])
    networks = ("--network", "20mbit,20ms-rtt", "--network", "unshaped")
    result = tigas_compare("--out", str(out), *networks, "--profile", "seen", "--profile", "2")
    assert result.exit_code == 0, result.output
    modes = ("stateless-seen_0", "stateless-2_0", "dash-typical_0", "dash-tuned_0", "dash-edge_0")
    assert stub.made == [f"courtyard_stroll_{net}_{mode}" for net in ("20mbit-20ms-rtt", "unshaped") for mode in modes]
    assert sorted(path.name for path in (out / "runs").iterdir()) == sorted(stub.made)
    record = read_experiment(out)
    assert (record.source, record.planned, record.name) == ("command", 10, "out")
    assert record.command == "tigas compare --profile seen"
    assert stub.reported == [out]
    again = tigas_compare("--out", str(out))
    assert (again.exit_code, len(stub.made)) == (1, 10)
    assert f"{out} already exists; choose another folder with --out." in again.output


def test_a_run_that_fails_costs_the_exit_status_and_no_other_run(stub: Stub, out: Path) -> None:
    stub.happenings = [None, fails]
    result = tigas_compare("--out", str(out))
    assert result.exit_code == 1
    assert result.output.splitlines() == [
        f"4 runs, about 7 minutes, into {out}",
        "1/4 Stateless seen, 20mbit,20ms-rtt, stroll",
        "2/4 DASH typical, 20mbit,20ms-rtt, stroll: The viewer failed: Target closed",
        "3/4 DASH tuned, 20mbit,20ms-rtt, stroll",
        "4/4 DASH edge, 20mbit,20ms-rtt, stroll",
    ]
    assert (len(stub.made), stub.reported) == (4, [out])


def test_when_nothing_works_there_is_a_report_of_that_too(stub: Stub, out: Path) -> None:
    stub.happenings = [fails] * 5
    result = tigas_compare("--out", str(out), "--network", "unshaped", "--network", "20mbit")
    assert result.exit_code == 1
    assert "5 runs in a row failed" in result.output
    assert stub.reported == [out]


def test_without_a_browser_it_says_what_to_install(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(out.parent))
    status, _, errors = finished(compare("--url", "http://127.0.0.1:9", "--out", str(out)))
    assert status == 1
    assert "No Chromium or Chrome is installed: sudo apt-get install chromium" in errors
