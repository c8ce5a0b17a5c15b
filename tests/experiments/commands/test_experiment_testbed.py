"""`tigas experiment run` over the real link of the namespace lab: processes, measurements and cleanup."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from tests.experiments.commands.test_experiment import report
from tests.experiments.processes import finished, started, until
from tests.experiments.run.test_plan import toml
from tests.prerequisites import BUILT_PAGE, CHROMIUM, FREE_LAB, NAMESPACES
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.wire.recording import LinkSample
from tigas_testbed.namespaces import Lab
from tigas_testbed.services import NAME

pytestmark = pytest.mark.alone


def experiment(out: Path, *networks: str, duration_s: float = 3, labs: int = 1) -> subprocess.Popen[str]:
    file = out.with_suffix(".toml")
    file.write_text(toml(networks=networks, controllers=[2], duration_s=duration_s, viewport="320x180"))
    return started("experiment", "run", str(file), "--out", str(out), "--labs", str(labs))


@pytest.fixture(autouse=True)
def lab() -> Iterator[None]:
    """Require a free lab; none of it may remain after the test."""
    for prerequisite in (BUILT_PAGE, CHROMIUM, NAMESPACES, FREE_LAB):
        prerequisite.require()
    yield
    assert not Lab(NAME).exists()
    links = subprocess.run(("ip", "-br", "link"), check=True, capture_output=True, text=True).stdout
    assert "tigas-lab" not in links


@pytest.mark.extended
def test_a_trace_s_file_is_played_and_frames_cross_the_link(tmp_path: Path) -> None:
    trace = tmp_path / "slow.csv"
    trace.write_text(
        "t_ms,down_kbps,up_kbps,delay_ms,jitter_ms,loss_pct\n0,6000,6000,40,0,0\n2000,3000,,,,\n60000,,,,,\n"
    )
    out = tmp_path / "out"
    status, _, errors = finished(experiment(out, trace.name))
    assert status == 0, errors
    (run,) = report(out)
    figures = run["figures"]["values"]
    assert figures["motion_to_photon_p50_ms"] > 80, "a round trip of 80 ms"
    assert 3 < figures["link_mbit_s"] < 6
    assert 0.5 < figures["over_link_mbit_s"] < 6
    assert figures["over_link_mbit_s"] > figures["received_mbit_s"], "headers cross the link, too"
    assert abs(figures["trace_began_s"]) < 0.5, "the trace starts with the movement"
    assert run["record"]["backend"] in ("netem", "relay")
    stored = StoredRun(out / "runs" / run["folder"])
    assert {sample.target_kbps for sample in stored.read(LinkSample)} == {6000, 3000}


@pytest.mark.extended
def test_even_after_a_kill_nothing_is_left(tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = experiment(out, "20mbit,20ms-rtt", duration_s=60)
    until(process, lambda: any(out.glob("runs/*/run.json")), "the run never began")
    children = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    _, alive = psutil.wait_procs(children, timeout=20)
    assert alive == []


@pytest.mark.extended
def test_labs_share_an_experiment_over_links_of_their_own(tmp_path: Path) -> None:
    """Enough runs that the second lab starts before the first one has made all of them."""
    out = tmp_path / "out"
    rates = {20: 5, 40: 4, 60: 3, 80: 2}
    networks = [f"{mbit}mbit,{rtt_ms}ms-rtt" for rtt_ms, mbit in rates.items()]
    status, _, errors = finished(experiment(out, *networks, labs=2))
    assert status == 0, errors
    shaped = {}
    for folder in (out / "runs").iterdir():
        run = StoredRun(folder)
        shaped[run.record.configuration.network.rtt_ms] = {sample.target_kbps for sample in run.read(LinkSample)}
    assert shaped == {rtt_ms: {mbit * 1000} for rtt_ms, mbit in rates.items()}
