"""The claims, against runs that were made so that they hold or do not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.experiments.report.made_up_results import told, write_run
from tigas_experiments.report.blocks import LEAST_BLOCKS
from tigas_experiments.report.claims import claims
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.results import load
from tigas_experiments.report.verdicts import Claim


def found(folder: Path, *runs: dict[str, Any]) -> dict[str, Claim]:
    """The claims over runs, each in as many blocks as an interval needs, by the words that tell them apart."""
    for number, run in enumerate(runs):
        for block in range(LEAST_BLOCKS):
            write_run(folder / "runs" / f"{number}-{block}", **{"movement": f"walk{block}", **run})
    return said_of(folder)


def said_of(folder: Path) -> dict[str, Claim]:
    """The claims over a folder's runs."""
    words = {
        "slower": "mean response is longer than LoL+'s",
        "lol+": "less often than LoL+",
        "l2a": "less often than L2A",
        "response": "p95 response",
        "frames": "new views a second",
        "height": "greater height",
        "ssim": "better SSIM",
    }
    return told(claims(Groups.of(load(folder).runs)), words)


def test_without_runs_that_apply_there_is_no_verdict(tmp_path: Path) -> None:
    said = found(
        tmp_path, {"controller": "l2a", "rtt_ms": None}, {"controller": "latency", "rtt_ms": None, "network": "x"}
    )
    assert {claim.verdict for claim in said.values()} == {"no data"}


@pytest.mark.parametrize(("hold", "verdict"), [(5, "holds"), (50, "does not hold")])
def test_fewer_switches(tmp_path: Path, hold: int, verdict: str) -> None:
    said = found(
        tmp_path,
        {"controller": "latency", "rungs": (1, 2), "hold": 25},
        {"controller": "lol+", "rungs": (1, 2), "hold": hold},
    )
    assert said["lol+"].verdict == verdict
    assert said["lol+"].figures.startswith("Latency 90.0, LoL+ ")
    at = "1 of 1" if verdict == "holds" else "0 of 1"
    assert said["lol+"].figures.endswith(f"less often at {at} networks and round trips.")
    assert said["l2a"].verdict == "no data"


@pytest.mark.parametrize(("late", "verdict"), [(99.0, "holds"), (100.0, "does not hold")])
def test_response_at_short_round_trips(tmp_path: Path, late: float, verdict: str) -> None:
    said = found(
        tmp_path,
        {"delay_ms": 30, "rtt_ms": 20.0},
        {"delay_ms": late, "rtt_ms": 50.0},
        {"delay_ms": 400, "rtt_ms": 100.0},
        {"controller": "budget", "delay_ms": 25, "rtt_ms": 20.0},
    )
    claim = said["response"]
    assert (claim.verdict, claim.text.endswith("over bus")) == (verdict, True)
    assert claim.figures == f"30 ms [30, 30] at 20 ms (Budget 25); {late:.0f} ms [{late:.0f}, {late:.0f}] at 50 ms."


@pytest.mark.parametrize(("took", "verdict"), [(99.0, "holds"), (100.0, "does not hold")])
def test_the_paper_s_response_ends_with_the_last_byte(tmp_path: Path, took: float, verdict: str) -> None:
    said = found(
        tmp_path,
        {"delay_ms": 130, "reply_ms": 30.0, "rtt_ms": 20.0},
        {"delay_ms": 150, "reply_ms": took, "rtt_ms": 50.0},
        {"controller": "budget", "reply_ms": 25.0, "rtt_ms": 20.0},
        {"controller": "l2a", "rtt_ms": 20.0},
    )
    claim = said["response"]
    assert (claim.verdict, "from asking to the last byte" in claim.text) == (verdict, True)
    assert claim.figures == f"30 ms [30, 30] at 20 ms (Budget 25); {took:.0f} ms [{took:.0f}, {took:.0f}] at 50 ms."


def test_where_a_run_has_no_replies_all_are_judged_by_what_is_on_the_screen(tmp_path: Path) -> None:
    said = found(tmp_path, {"delay_ms": 90, "reply_ms": 30.0, "rtt_ms": 20.0}, {"delay_ms": 80, "rtt_ms": 50.0})
    assert "from the pose to the screen" in said["response"].text
    assert said["response"].figures == "90 ms [90, 90] at 20 ms; 80 ms [80, 80] at 50 ms."


@pytest.mark.parametrize(("every", "verdict"), [(1, "holds"), (3, "does not hold")])
def test_frame_rate_at_a_long_round_trip(tmp_path: Path, every: int, verdict: str) -> None:
    said = found(tmp_path, {"every": every, "rtt_ms": 300.0}, {"every": 4, "rtt_ms": 200.0})
    assert said["frames"].verdict == verdict


def test_budget_must_win_both(tmp_path: Path) -> None:
    latency = {"controller": "latency", "delay_ms": 130, "rungs": (1,), "view_ssim": 0.7}
    said = found(tmp_path / "a", latency, {"controller": "budget", "rungs": (1,), "view_ssim": 0.6})
    assert (said["height"].verdict, said["ssim"].verdict) == ("holds", "does not hold")
    said = found(tmp_path / "b", latency, {"controller": "budget", "rungs": (2,), "view_ssim": 0.7})
    assert (said["height"].verdict, said["ssim"].verdict) == ("does not hold", "holds")
    assert said["height"].figures.startswith("Budget 100.0 % at 480 px, Latency 0.0 % at 720 px; ")
    said = found(tmp_path / "c", {**latency, "delay_ms": 50}, {"controller": "budget", "rungs": (0,)})
    assert said["height"].verdict == "does not hold", "equal shares are not more"


def test_a_verdict_says_what_it_owes_to_the_machine(tmp_path: Path) -> None:
    said = found(tmp_path, {"delay_ms": 300, "busy": 1.0}, {"delay_ms": 300, "repeat": 1})
    assert said["response"].figures == "300 ms [300, 300] at 20 ms. Processors were saturated in 6 of these 12 runs."


def test_each_reading_of_latency_that_has_runs_is_judged_by_itself(tmp_path: Path) -> None:
    found(
        tmp_path,
        {"controller": "latency", "rungs": (1,)},
        {"controller": "latency-transfer", "rungs": (1, 2), "hold": 25, "delay_ms": 130.0},
        {"controller": "lol+", "rungs": (1, 2), "hold": 50},
    )
    verdicts = {claim.text: claim.verdict for claim in claims(Groups.of(load(tmp_path).runs))}
    assert verdicts["Latency changes its profile less often than LoL+"] == "holds"
    assert verdicts["Latency (transfer) changes its profile less often than LoL+"] == "does not hold"
    responses = {text.split("'s")[0]: verdict for text, verdict in verdicts.items() if "p95 response" in text}
    assert responses == {"Latency": "holds", "Latency (transfer)": "does not hold"}
    assert "Budget has more inputs within 108 ms than Latency (transfer), at an equal or greater height" in verdicts


@pytest.mark.parametrize(("delay_ms", "verdict"), [(50, "holds"), (40, "does not hold"), (30, "does not hold")])
def test_a_longer_mean_response(tmp_path: Path, delay_ms: float, verdict: str) -> None:
    said = found(tmp_path, {"delay_ms": delay_ms}, {"controller": "lol+", "delay_ms": 40})
    assert said["slower"].verdict == verdict
    assert "Impact of Round-Trip Time" in said["slower"].whose


def test_there_is_no_verdict_without_an_interval(tmp_path: Path) -> None:
    for block in range(LEAST_BLOCKS - 1):
        for repeat in (0, 1):
            for name, delay in (("latency", 60), ("lol+", 40)):
                run = tmp_path / "runs" / f"{name}-{block}-{repeat}"
                write_run(run, name, movement=f"walk{block}", repeat=repeat, delay_ms=delay)
    said = said_of(tmp_path)
    assert (said["slower"].verdict, said["response"].verdict) == ("not certain", "not certain"), "repeats are no blocks"
    assert said["response"].figures.startswith("60 ms [no interval over 5 blocks] at 20 ms")


def test_an_interval_on_both_sides_is_not_certain(tmp_path: Path) -> None:
    for block, delay in enumerate((20, 30, 90, 95, 20, 30)):
        write_run(tmp_path / "runs" / f"a{block}", "latency", movement=f"walk{block}", delay_ms=delay)
        write_run(tmp_path / "runs" / f"b{block}", "lol+", movement=f"walk{block}", delay_ms=45)
    said = said_of(tmp_path)
    assert said["slower"].verdict == "not certain"
    assert "; difference +2 [-" in said["slower"].figures


def test_what_is_the_paper_s_and_what_is_ours(tmp_path: Path) -> None:
    said = found(tmp_path, {})
    assert {name for name, claim in said.items() if claim.whose != "ours"} == {"lol+", "l2a", "slower"}
    assert said["l2a"].whose == "the paper's: Performance Evaluation, Results, (d) Quality Switches"
