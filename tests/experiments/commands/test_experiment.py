"""`tigas experiment run` as a person uses it: in a real browser, which is killed, against real services."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.experiments.conftest import Services
from tests.experiments.processes import finished, started, until
from tests.experiments.run.test_plan import toml


def run(services: Services, file: Path) -> subprocess.Popen[str]:
    """Start it; its folder is next to the file."""
    return started("experiment", "run", str(file), "--out", str(file.parent / "out"), "--url", services.url)


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
    fields = {"controllers": ["latency", 2, 3], "duration_s": 2, "warm_up_s": 0.5, "viewport": "320x180"}
    file.write_text(toml(scenes=["pebbles"], networks=["20mbit,20ms-rtt"], **fields))
    before = len(services.shaper.asked)
    process = run(services, file)
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

    status, output, errors = finished(run(services, file))
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
