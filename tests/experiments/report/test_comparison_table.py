"""The table of a comparison."""

from __future__ import annotations

from pathlib import Path

from tests.experiments.made_up import write_run
from tigas_common.wire.run import Network
from tigas_experiments.records.folder import RunRecord, StoredRun
from tigas_experiments.report.comparison_table import by_network, label, markdown, runs_as_made, titles
from tigas_experiments.report.results import load


def test_a_markdown_table_has_a_row_for_each_run(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "1")
    write_run(tmp_path / "runs" / "2", "dash-tuned", 140)
    write_run(tmp_path / "runs" / "3", network=Network(trace="a|b"))
    (write_run(tmp_path / "runs" / "4") / "inputs.ndjson").unlink()
    lines = markdown(runs_as_made(load(tmp_path))).splitlines()
    assert len(lines) == 2 + 4
    assert lines[2].startswith("| 20mbit,20ms-rtt | Stateless, budget | 40 | 40 | 40 | 100.0 | ")
    assert len({line.replace("\\|", "").count("|") for line in lines}) == 1


def test_a_run_is_called_by_its_mode_controller_and_repeat(tmp_path: Path) -> None:
    def record(**changes: object) -> RunRecord:
        return StoredRun(write_run(tmp_path / f"{len(list(tmp_path.iterdir()))}", **changes)).record  # type: ignore[arg-type]

    assert label(record()) == "Stateless, budget"
    assert label(record(profile=2, repeat=1)) == "Stateless, rung 2 (2)"
    assert label(record(mode="dash-typical")) == "DASH, typical"


def test_runs_stand_in_the_order_in_which_they_were_made(tmp_path: Path) -> None:
    for number, (mode, started) in enumerate((("dash-tuned", 2), ("dash-typical", 1), ("stateless", 0))):
        path = write_run(tmp_path / "runs" / f"{number}", mode) / "run.json"  # type: ignore[arg-type]
        path.write_text(path.read_text().replace("T00:00:00", f"T00:00:0{started}"))
    (tmp_path / "runs" / "1" / "inputs.ndjson").unlink()
    made = runs_as_made(load(tmp_path))
    assert [run.record.configuration.mode for run in made] == ["stateless", "dash-typical", "dash-tuned"]
    assert [run.problem is None for run in made] == [True, False, True]


def test_runs_of_one_controller_stand_together_and_are_told_apart(tmp_path: Path) -> None:
    for number, (profile, scene) in enumerate(((2, "room"), ("budget", "room"), (2, "garden"), ("budget", "garden"))):
        write_run(tmp_path / "runs" / f"{number}", profile=profile, scene=scene)
    (runs,) = by_network(runs_as_made(load(tmp_path))).values()
    assert list(titles(runs).values()) == [
        "Stateless, rung 2, room",
        "Stateless, rung 2, garden",
        "Stateless, budget, room",
        "Stateless, budget, garden",
    ]
    assert list(titles(runs[:1]).values()) == ["Stateless, rung 2"]
