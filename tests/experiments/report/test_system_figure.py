"""The system panel: latency broken down into parts that add up, and its CSV file."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.experiments.made_up import frame, inputs, reply
from tests.experiments.report.made_up_results import write_run
from tests.experiments.report.test_cli import page_text, rows
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.latency_parts import LatencyParts
from tigas_experiments.report.report import write_report
from tigas_experiments.report.results import load
from tigas_experiments.report.system_figure import system_panel


def test_the_parts_of_a_frames_age_add_up_to_it() -> None:
    (sampled,) = inputs(1, start=100.0)
    answer = reply(asked_at=104.0, took_ms=40.0, pose=sampled.pose)
    parts = LatencyParts.of([sampled], [frame(160.0, sampled.pose), frame(176.0, sampled.pose)], [answer])
    assert parts is not None
    assert parts.by_name == {"wait": 4, "queue": 0, "render": 11, "encode": 1, "network": 28, "enhance": 0, "page": 16}
    assert sum(parts.by_name.values()) == 160 - 100


def test_enhancement_is_a_part_of_its_own() -> None:
    (sampled,) = inputs(1, start=100.0)
    answer = reply(asked_at=104.0, took_ms=40.0, pose=sampled.pose)
    for took, expected in ((6.5, (6.5, 9.5)), (99.0, (16.0, 0.0))):
        shown = frame(160.0, sampled.pose).model_copy(update={"enhance_ms": took})
        parts = LatencyParts.of([sampled], [shown], [answer])
        assert parts is not None
        assert (parts.enhance, parts.page) == expected


def test_frames_whose_reply_is_unknown_do_not_count() -> None:
    sampled = inputs(3)
    answers = [reply(sampled[0].at, 30.0, sampled[0].pose), reply(sampled[2].at, 30.0, sampled[2].pose)]
    shown = [frame(50.0, sampled[0].pose), frame(70.0, sampled[1].pose), frame(72.0, sampled[0].pose)]
    parts = LatencyParts.of(sampled, shown, answers)
    assert parts is not None
    assert parts.page == 20
    assert LatencyParts.of(sampled, shown[1:2], answers) is None
    silent = [answer.model_copy(update={"server": None}) for answer in answers]
    assert LatencyParts.of(sampled, shown, silent) is None


def test_the_panel_and_its_values(tmp_path: Path) -> None:
    for name, took in (("latency", 60.0), ("budget", 30.0)):
        for network in ("bus", "train"):
            write_run(tmp_path / "runs" / f"{name}-{network}", name, network, delay_ms=took + 16, reply_ms=took)
    write_run(tmp_path / "runs" / "dash", network="bus", mode="dash-edge", delay_ms=80)
    panel = system_panel(Groups.of(load(tmp_path).runs))
    assert panel is not None
    assert panel.title == "The oldest frames are those of Latency over bus, 76 ms; the largest part: network"
    for text in ("Rendering", "Encoding", "Latency, train", "Received, Mbit/s", "Median height", "Profile changes"):
        assert text in panel.svg
    write_report(tmp_path, tmp_path)
    assert panel.title in page_text(tmp_path)
    found = rows(tmp_path / "system.csv")
    assert [(row["network"], row["controller"]) for row in found] == [
        ("bus", "latency"),
        ("bus", "budget"),
        ("train", "latency"),
        ("train", "budget"),
    ]
    assert float(found[0]["network_ms"]) == pytest.approx(60 - 12)
    assert float(found[0]["page_ms"]) == pytest.approx(16)
    assert float(found[1]["render_mean_ms"]) == pytest.approx(11)
    assert float(found[1]["received_mbit_s"]) == pytest.approx(8, rel=0.1)


def test_without_replies_there_is_no_panel(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "a")
    assert system_panel(Groups.of(load(tmp_path).runs)) is None
    write_report(tmp_path, tmp_path)
    assert rows(tmp_path / "system.csv") == []
