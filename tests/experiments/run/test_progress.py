"""Progress of running experiments."""

from __future__ import annotations

import io
from pathlib import Path

from rich.console import Console

from tests.experiments.made_up import MACHINE
from tigas_experiments.records.folder import RunRecord
from tigas_experiments.report.controllers import run_names
from tigas_experiments.run.experiment import Experiment
from tigas_experiments.run.plan import ExperimentPlan
from tigas_experiments.run.progress import progress

PLAN = {
    "name": "compare",
    "scenes": ["courtyard"],
    "movements": ["stroll"],
    "networks": ["20mbit,20ms-rtt"],
    "modes": ["stateless", "dash-tuned"],
    "shuffled": False,
}


def seen(console: Console, folder: Path, done: int = 0) -> None:
    """One run, after a number of others."""
    made = Experiment.of(ExperimentPlan.of(PLAN, "here"), folder, Path("out"), "tigas compare")
    with progress(made, made.runs[done:], run_names(made.runs), console) as listener:
        listener.on_stage("starts the services")
        listener.on_begin(made.runs[done])
        listener.on_stage("compares with ground truth")
        listener.on_finish(
            RunRecord(status="complete", problem=None, configuration=made.runs[done], machine=MACHINE, started="now")
        )


def test_a_log_says_how_long_it_takes_and_has_a_line_a_run(tmp_path: Path) -> None:
    log = io.StringIO()
    seen(Console(file=log, width=80), tmp_path)
    seen(Console(file=log, width=80), tmp_path, done=1)
    assert [line for line in log.getvalue().splitlines() if line] == [
        "2 runs, about 50 seconds, into out",
        "1/2 Stateless seen, 20mbit,20ms-rtt, stroll",
        "1 of 2 runs, about 25 seconds, into out",
        "2/2 DASH tuned, 20mbit,20ms-rtt, stroll",
    ]


def test_a_terminal_shows_the_whole_name_of_the_run_that_is_made(tmp_path: Path) -> None:
    for width in (80, 50):
        screen = io.StringIO()
        seen(Console(file=screen, width=width, force_terminal=True, color_system=None), tmp_path)
        words = screen.getvalue().split()
        for word in ("1/2", "Stateless", "seen,", "20mbit,20ms-rtt,", "stroll:", "ground", "truth"):
            assert word in words
        assert "…" not in screen.getvalue()
