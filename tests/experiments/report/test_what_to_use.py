"""What to use when: who is the best where, and when nobody can tell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.experiments.report.made_up_results import download, write_run
from tests.experiments.report.test_cli import page_text, run_report
from tests.experiments.report.test_cli import rows as csv_rows
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.results import load
from tigas_experiments.report.tables import what_to_use_markdown
from tigas_experiments.report.what_to_use import Place, places, tally

LATENCY, SEEN, BYTES = "Lowest motion-to-photon p95", "Best picture seen", "Fewest bytes"
MODES: dict[str, dict[str, Any]] = {
    "stateless": {"controller": "budget", "delay_ms": 40.0, "kbps": 9000.0, "view_ssim": 0.9},
    "dash-edge": {"mode": "dash-edge", "delay_ms": 200.0, "kbps": 3000.0, "view_ssim": 0.7},
}


def found(folder: Path, modes: Mapping[str, Mapping[str, Any]], blocks: int = 6, **shared: Any) -> list[Place]:
    """Where the best was looked for, in runs of these modes in so many blocks, in which delays differ a little."""
    for name, mode in modes.items():
        for block in range(blocks):
            late = {**mode, "delay_ms": mode["delay_ms"] + block % 3}
            write_run(folder / "runs" / f"{name}-{block}", movement=f"walk-{block}", seconds=1.0, **late, **shared)
    return places(Groups.of(load(folder).runs))


def test_the_best_is_another_one_by_each_figure(tmp_path: Path) -> None:
    (place,) = found(tmp_path, MODES)
    assert (place.network, place.rtt_ms, place.scene_text) == ("bus", 20.0, "courtyard, 10.0 MB")
    best = {question: answer.best.controller.mode for question, answer in place.answers.items()}
    assert (best[LATENCY], best[SEEN], best[BYTES]) == ("stateless", "stateless", "dash-edge")
    assert all(answer.decided and not answer.alike for answer in place.answers.values())
    assert place.answers[BYTES].metric.name == "over_link_mbit_s", "everything counts, headers as well"
    assert tally([place])[BYTES] == [("DASH, edge", 1)]


def test_a_download_is_told_in_seconds_of_pictures(tmp_path: Path) -> None:
    local = {"mode": "local-ply", "delay_ms": 20.0, "kbps": 8000.0, "local": download(0.5, 1.0, size=3_000_000)}
    (place,) = found(tmp_path, {**MODES, "local": local})
    assert place.even is not None
    assert place.even.text == "Local, PLY has 3.0 MB in all, as much as 8 s of DASH, edge"


def test_where_intervals_overlap_no_difference_is_shown(tmp_path: Path) -> None:
    alike = {**MODES, "video": {**MODES["stateless"], "mode": "video", "controller": "l2a"}}
    (place,) = found(tmp_path, alike)
    answer = place.answers[SEEN]
    assert {answer.best.controller.mode, *(each.controller.mode for each in answer.alike)} == {"stateless", "video"}
    assert answer.contenders[-1].verdict == "worse"
    assert tally([place])[SEEN] == [("no difference shown", 1)]


def test_a_mode_is_marked_where_the_machine_was_the_bottleneck(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "busy", movement="walk-0", seconds=1.0, busy=1.0, repeat=1, **MODES["stateless"])
    (place,) = found(tmp_path, MODES)
    answer = place.answers[SEEN]
    assert [each.name for each in answer.contenders] == ["Stateless, budget*", "DASH, edge"]
    assert answer.told(answer.best) == "Stateless, budget* 0.900"


def test_few_blocks_decide_nothing(tmp_path: Path) -> None:
    (place,) = found(tmp_path, MODES, blocks=5)
    assert not place.answers[LATENCY].decided
    assert {each.verdict for each in place.answers[LATENCY].contenders} == {"best", "no interval"}
    assert tally([place])[LATENCY] == [("fewer than 6 blocks", 1)]


def test_what_never_came_is_the_worst(tmp_path: Path) -> None:
    never = {**MODES, "local": {"mode": "local-ply", "delay_ms": 40.0, "every": 1000, "kbps": 20_000.0}}
    (place,) = found(tmp_path, never)
    last = place.answers[LATENCY].contenders[-1]
    assert (last.controller.mode, last.mean, last.verdict) == ("local-ply", math.inf, "worse")


def test_modes_are_compared_in_the_blocks_that_all_have(tmp_path: Path) -> None:
    found(tmp_path, MODES, blocks=7)
    run = tmp_path / "runs" / "dash-edge-6" / "run.json"
    run.write_text(run.read_text().replace('"status": "complete"', '"status": "failed"'))
    (place,) = places(Groups.of(load(tmp_path).runs))
    assert place.answers[LATENCY].blocks == 6


def test_scenes_are_told_apart_and_taken_together_the_smallest_first(tmp_path: Path) -> None:
    found(tmp_path, MODES, scene="garden")
    for path in (tmp_path / "runs").iterdir():
        path.rename(path.with_name(f"garden-{path.name}"))
    every = found(tmp_path, MODES)
    assert [place.scene for place in every] == [None, "courtyard", "garden"]
    assert every[0].answers[LATENCY].blocks == 12
    said = run_report(tmp_path).output
    assert f"{BYTES}: DASH, edge 2" in said
    assert "no data" not in said, "claims about others"
    assert "Stateless, budget" in (tmp_path / "what_to_use.md").read_text()
    text = page_text(tmp_path)
    assert "What to use when" in text
    assert "Stateless, budget" in text
    row = csv_rows(tmp_path / "what_to_use.csv")[-1]
    assert (row["scene"], row["question"], row["verdict"]) == ("garden", BYTES, "worse")


def test_networks_are_told_apart_and_taken_together(tmp_path: Path) -> None:
    for trace in ("bus", "train"):
        for name, mode in MODES.items():
            for block in range(3):
                folder = tmp_path / "runs" / f"{trace}-{name}-{block}"
                write_run(folder, network=trace, movement=f"walk-{block}", seconds=1.0, **mode)
    every = places(Groups.of(load(tmp_path).runs))
    assert [(place.network, place.answers[SEEN].blocks) for place in every] == [
        ("all networks", 6),
        ("bus", 3),
        ("train", 3),
    ]
    assert every[0].answers[SEEN].decided, "three blocks of each network are six of both"
    assert tally(every)[SEEN] == [("fewer than 6 blocks", 2)], "places count once"


def test_a_table_for_docs_says_who_is_best(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "busy", movement="walk-0", seconds=1.0, busy=1.0, repeat=1, **MODES["stateless"])
    alike = {"video": {**MODES["stateless"], "mode": "video", "controller": "l2a"}}
    every = found(tmp_path, {**MODES, **alike})
    text = what_to_use_markdown(load(tmp_path), every)
    assert text.startswith("19 runs of 1 s at ")
    table = [line for line in text.splitlines() if line.startswith("|")]
    (dash,) = (line for line in table if "DASH" in line)
    (stateless,) = (line for line in table if "Stateless, budget\\*" in line)
    (video,) = (line for line in table if "Video" in line)
    assert dash.endswith("| 201 | 201 | 0.700 | **3.0** |")
    assert "| 0.900 |" not in stateless + video, "both are marked"
    assert "| **0.900** |" in stateless + video
    assert "| *0.900* |" in stateless + video


def test_controllers_of_one_mode_are_no_modes_to_choose_from(tmp_path: Path) -> None:
    one = {"budget": MODES["stateless"], "latency": {**MODES["stateless"], "controller": "latency"}}
    assert found(tmp_path, one) == []
