"""The goals of reprojection, against runs that were made so that they are met or not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.experiments.report.made_up_results import told, write_run
from tigas_experiments.report.blocks import LEAST_BLOCKS
from tigas_experiments.report.claims import claims
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.report import write_report
from tigas_experiments.report.reprojection_claims import reprojection_claims
from tigas_experiments.report.results import load
from tigas_experiments.report.verdicts import Claim

WITH: dict[str, Any] = {"reprojection": True, "prediction": "auto", "turned_ms": 16.0}


def write_runs(folder: Path, **turned: Any) -> None:
    """Two round trips without and with, in as many blocks as an interval needs; what is seen is worse far away."""
    for block in range(LEAST_BLOCKS):
        for rtt in (20.0, 100.0, 300.0):
            late: dict[str, Any] = {"delay_ms": rtt + 40, "movement": f"walk{block}.csv", "rtt_ms": rtt}
            plain = 0.8 - rtt / 1000 + block / 100
            write_run(folder / f"runs/without-{rtt}-{block}", "budget", **late, view_ssim=plain)
            seen: dict[str, Any] = {"view_ssim": 0.9 - rtt / 10_000 + block / 100}
            write_run(folder / f"runs/with-{rtt}-{block}", "budget", **{**late, **seen, **WITH, **turned})
            for rung, better in ((1, 0.05), (2, 0.0)):
                fixed: dict[str, Any] = {"view_ssim": plain + better, "kbps": 12_000.0 / rung}
                write_run(folder / f"runs/fixed-{rung}-{rtt}-{block}", rung, **late, **fixed)


def said(folder: Path) -> dict[str, Claim]:
    words = {
        "latency": "p95 of view latency",
        "far": "SSIM of what is seen at 300 ms is no worse",
        "near": "SSIM of what is seen is better than Budget's",
        "rate": "at equal Mbit/s",
        "border": "never seen",
        "cost": "main thread",
        "lpips": "LPIPS of what is seen at 300 ms",
    }
    return told(reprojection_claims(Groups.of(load(folder).runs)), words)


def test_goals_that_are_met(tmp_path: Path) -> None:
    write_runs(tmp_path)
    found = said(tmp_path)
    assert found.pop("lpips").verdict == "no data", "nobody ran tigas quality"
    assert {name: claim.verdict for name, claim in found.items()} == dict.fromkeys(found, "holds")
    assert "16 ms [16, 16] at 300 ms (p50 16, without p95 340)" in found["latency"].figures
    assert "with 0.895, without 0.805; difference +0.090 [0.090, 0.090]" in found["far"].figures
    assert "(6 of 6 blocks overlap)" in found["rate"].figures
    write_report(tmp_path, tmp_path)
    assert "p95 of view latency is at most 34 ms" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("turned", "missed"),
    [
        ({"turned_ms": 50.0}, "latency"),
        ({"view_ssim": 0.7}, "far"),
        ({"view_ssim": 0.7}, "near"),
        ({"uncovered": 0.03}, "border"),
    ],
)
def test_goals_that_are_missed(tmp_path: Path, turned: dict[str, Any], missed: str) -> None:
    write_runs(tmp_path, **turned)
    assert said(tmp_path)[missed].verdict == "does not hold"


def test_generated_movements_say_nothing_of_recorded_heads(tmp_path: Path) -> None:
    write_runs(tmp_path)
    for block in range(LEAST_BLOCKS):
        where: dict[str, Any] = {"movement": "quick-turns", "scene": f"room{block}", "rtt_ms": 100.0}
        write_run(tmp_path / f"runs/turns-{block}", "budget", **{**where, **WITH, "uncovered": 0.5})
    assert said(tmp_path)["border"].verdict == "holds"


def test_without_reprojection_nothing_is_said_of_it(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "a", "budget")
    assert not any("view latency" in claim.text for claim in claims(Groups.of(load(tmp_path).runs)))
