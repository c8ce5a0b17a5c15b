"""The table of a network's runs."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from tests.experiments.made_up import write_run
from tigas_experiments.report.run_listing import by_network, markdown, run_label, terminal_tables, titles
from tigas_experiments.report.run_table import Run, load_results
from tigas_experiments.wire.run import DASH, Network


def listed(folder: Path, *runs: dict[str, Any]) -> list[Run]:
    """Runs over one network, in the order of their listing."""
    for number, run in enumerate(runs):
        write_run(folder / "runs" / f"{number}", **run)
    (found,) = by_network(load_results(folder).made).values()
    return found


def printed(runs: Sequence[Run], width: int) -> list[str]:
    """Lines of a terminal of this width, without the space at their ends."""
    screen = io.StringIO()
    for table in terminal_tables("20mbit", runs, width):
        Console(file=screen, width=width).print(table)
    return [line.rstrip() for line in screen.getvalue().splitlines()]


def test_a_markdown_table_has_a_row_for_each_run(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "1")
    write_run(tmp_path / "runs" / "2", "dash-tuned", 140)
    write_run(tmp_path / "runs" / "3", network=Network(trace="a|b"))
    (write_run(tmp_path / "runs" / "4") / "inputs.ndjson").unlink()
    lines = markdown(load_results(tmp_path).made).splitlines()
    assert len(lines) == 2 + 4
    assert lines[2].startswith("| 20mbit,20ms-rtt | Stateless, seen | 40 | 40 | 40 | 100.0 | ")
    assert sum("| no result: runs/4/inputs.ndjson cannot be read" in line for line in lines) == 1
    assert len({line.replace("\\|", "").count("|") for line in lines}) == 1


def test_a_run_is_called_by_its_mode_controller_and_repeat(tmp_path: Path) -> None:
    runs = listed(tmp_path, {}, {"profile": 2, "repeat": 1}, {"mode": "dash-typical"})
    assert list(map(run_label, runs)) == ["Stateless, seen", "Stateless, rung 2 (2)", "DASH, typical"]


def test_runs_stand_in_the_order_in_which_they_were_made(tmp_path: Path) -> None:
    for number, started in enumerate((2, 1, 0)):
        path = write_run(tmp_path / "runs" / f"{number}") / "run.json"
        path.write_text(path.read_text().replace("T00:00:00", f"T00:00:0{started}"))
    (tmp_path / "runs" / "1" / "inputs.ndjson").unlink()
    made = load_results(tmp_path).made
    assert [(run.name, run.problem is None) for run in made] == [("2", True), ("1", False), ("0", True)]


def test_runs_of_one_controller_stand_together_and_are_told_apart(tmp_path: Path) -> None:
    named = ((2, "room"), ("seen", "room"), (2, "garden"), ("seen", "garden"))
    runs = listed(tmp_path, *({"profile": profile, "scene": scene} for profile, scene in named))
    assert titles(runs) == [
        "Stateless, rung 2, room",
        "Stateless, rung 2, garden",
        "Stateless, seen, room",
        "Stateless, seen, garden",
    ]
    assert titles(runs[:1]) == ["Stateless, rung 2"]


@pytest.mark.parametrize("width", [80, 60])
def test_in_a_terminal_no_name_is_cut_whatever_its_width(tmp_path: Path, width: int) -> None:
    modes = ("stateless", "video", "dash-typical", "dash-tuned", "dash-edge", "local-compressed")
    runs = listed(tmp_path, *({"mode": mode, "profile": "latency-transfer"} for mode in modes))
    lines = printed(runs, width)
    assert max(map(len, lines)) <= width
    words = " ".join(lines).split()
    assert "…" not in "".join(words)
    for word in ("Stateless,", "latency-transfer", "Video,", "typical", "tuned", "edge", "Local,", "compressed"):
        assert word in words
    assert sum("within 108 ms, %" in line for line in lines) == lines.count("20mbit") == 2


def test_a_word_that_is_wider_than_the_terminal_goes_on_in_the_next_line(tmp_path: Path) -> None:
    lines = printed(listed(tmp_path, {"profile": "latency-transfer"}), 36)
    assert max(map(len, lines)) == 36
    assert "".join(line.strip() for line in lines[1:4]) == "Stateless,latency-transfer"


def test_four_modes_stand_side_by_side_in_80_columns(tmp_path: Path) -> None:
    lines = printed(listed(tmp_path, *({"mode": mode} for mode in ("stateless", *DASH))), 80)
    assert [line.split() for line in lines[:4]] == [
        ["20mbit"],
        ["Stateless,", "DASH,", "DASH,", "DASH,"],
        ["seen", "typical", "tuned", "edge"],
        ["Motion-to-photon"],
    ]
    assert any(line.split() == ["p50,", "ms", "40", "40", "40", "40"] for line in lines)
    assert not any("border never" in line for line in lines), "which no run has"


def test_runs_without_figures_need_no_table(tmp_path: Path) -> None:
    (write_run(tmp_path / "runs" / "0") / "inputs.ndjson").unlink()
    (runs,) = by_network(load_results(tmp_path).made).values()
    assert printed(runs, 80) == []
