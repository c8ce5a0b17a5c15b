"""The table of a network's runs."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import pytest
from rich.console import Console

from tests.experiments.made_up import write_run
from tigas_experiments.records.folder import RunRecord, StoredRun
from tigas_experiments.report.results import Run, load
from tigas_experiments.report.run_listing import AnyRun, by_network, in_terminal, label, markdown, runs_as_made, titles
from tigas_experiments.wire.run import USUALLY_COMPARED, Mode, Network


def printed(network: str, runs: Sequence[AnyRun], width: int) -> list[str]:
    """Lines of a terminal of this width, without the space at their ends."""
    screen = io.StringIO()
    for table in in_terminal(network, runs, width):
        Console(file=screen, width=width).print(table)
    return [line.rstrip() for line in screen.getvalue().splitlines()]


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
    assert [run.record.configuration.mode for run in made if run.record] == ["stateless", "dash-typical", "dash-tuned"]
    assert [isinstance(run, Run) for run in made] == [True, False, True]


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


@pytest.mark.parametrize("width", [80, 60])
def test_in_a_terminal_no_name_is_cut_whatever_its_width(tmp_path: Path, width: int) -> None:
    modes: tuple[Mode, ...] = ("stateless", "video", "dash-typical", "dash-tuned", "dash-edge", "local-compressed")
    for number, mode in enumerate(modes):
        write_run(tmp_path / "runs" / f"{number}", mode, profile="latency-transfer")
    (runs,) = by_network(runs_as_made(load(tmp_path))).values()
    lines = printed("20mbit", runs, width)
    assert max(map(len, lines)) <= width
    words = " ".join(lines).split()
    assert "…" not in "".join(words)
    for word in ("Stateless,", "latency-transfer", "Video,", "typical", "tuned", "edge", "Local,", "compressed"):
        assert word in words
    assert sum("within 108 ms, %" in line for line in lines) == lines.count("20mbit") == 2


def test_a_word_that_is_wider_than_the_terminal_goes_on_in_the_next_line(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "1", profile="latency-transfer")
    (runs,) = by_network(runs_as_made(load(tmp_path))).values()
    lines = printed("20mbit", runs, 36)
    assert max(map(len, lines)) == 36
    assert "".join(line.strip() for line in lines[1:4]) == "Stateless,latency-transfer"


def test_four_modes_stand_side_by_side_in_80_columns(tmp_path: Path) -> None:
    for number, mode in enumerate(USUALLY_COMPARED):
        write_run(tmp_path / "runs" / f"{number}", mode)
    (runs,) = by_network(runs_as_made(load(tmp_path))).values()
    lines = printed("20mbit", runs, 80)
    assert [line.split() for line in lines[:4]] == [
        ["20mbit"],
        ["Stateless,", "DASH,", "DASH,", "DASH,"],
        ["budget", "typical", "tuned", "edge"],
        ["Motion-to-photon"],
    ]
    assert any(line.split() == ["p50,", "ms", "40", "40", "40", "40"] for line in lines)
    assert not any("border never seen" in line for line in lines), "which no run has"


def test_runs_without_figures_need_no_table(tmp_path: Path) -> None:
    (write_run(tmp_path / "runs" / "1") / "inputs.ndjson").unlink()
    (runs,) = by_network(runs_as_made(load(tmp_path))).values()
    assert printed("20mbit", runs, 80) == []
