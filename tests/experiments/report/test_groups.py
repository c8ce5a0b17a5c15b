"""Groups of runs with known figures, and their differences from a baseline."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from tests.experiments.made_up import configuration
from tests.experiments.report.synthetic_results import download, groups, write_run
from tigas_common.errors import StartError
from tigas_experiments.records.folder import ExperimentRecord
from tigas_experiments.records.statistics import IN_TIME
from tigas_experiments.report.estimates import Estimate
from tigas_experiments.report.groups import Groups, choose_baseline, describe_run_counts
from tigas_experiments.report.metrics import METRICS
from tigas_experiments.report.run_table import Block, load_results
from tigas_experiments.report.tables import overall_markdown
from tigas_experiments.report.warnings import collect_warnings
from tigas_experiments.wire.run import Network

AGE, RESPONSE = METRICS["frame_age_mean_ms"], METRICS["response_time_p50_ms"]


def run(controller: str | int, network: str, movement: str, delay_ms: float, **more: Any) -> dict[str, Any]:
    return {"controller": controller, "network": network, "movement": movement, "delay_ms": delay_ms, **more}


def known(estimate: Estimate | None) -> Estimate:
    assert estimate is not None
    return estimate


def block(**changes: Any) -> Block:
    """The block of a run over a bus."""
    return Block.from_configuration(
        configuration(**{"network": Network(trace="bus", rtt_ms=20, offset_s=60), **changes})
    )


def test_repeats_controllers_and_round_trips_share_a_block_and_other_inputs_do_not() -> None:
    same = [block(repeat=3), block(profile="lol+"), block(network=Network(trace="bus", rtt_ms=300, offset_s=60))]
    assert set(same) == {block()}
    other = [
        block(scene="guitar"),
        block(movement="a/orbit.csv"),
        block(movement_offset_s=8.0),
        block(network=Network(trace="bus", rtt_ms=20, offset_s=61)),
        block(network=Network(trace="train", rtt_ms=20, offset_s=60)),
    ]
    assert len({block(), *other}) == 6


def test_a_time_that_never_came_is_no_time(tmp_path: Path) -> None:
    path = write_run(tmp_path / "runs" / "a", delay_ms=40)
    frames = (path / "frames.ndjson").read_text().splitlines(keepends=True)
    (path / "frames.ndjson").write_text("".join(frames[:60]))
    (group,) = groups(tmp_path, {"repeat": 1})
    p95 = known(group.estimate(METRICS["motion_to_photon_p95_ms"]))
    assert (p95.low, p95.mean) == (40, math.inf)
    assert known(group.estimate(METRICS[IN_TIME])).mean == pytest.approx((60 + 100) / 2)


def test_a_repeat_counts_within_its_block_alone(tmp_path: Path) -> None:
    (group,) = groups(tmp_path, *(run("latency", "bus", name, ms) for name, ms in (("a", 40), ("a", 60), ("b", 110))))
    found = known(group.estimate(AGE))
    assert (found.mean, found.low, found.high, found.blocks) == (80, 40, 110, 2)


def test_runs_without_a_figure_do_not_count_for_it(tmp_path: Path) -> None:
    first, whole = METRICS["first_picture_s"], METRICS["whole_scene_s"]
    local = {"mode": "local-compressed", "local": download(0.5, None)}
    of_pictures, of_download = groups(tmp_path, {"controller": "seen"}, local)
    assert of_pictures.estimate(first) is None
    assert [of_download.blocks(metric).popitem()[1] for metric in (first, whole)] == [0.5, math.inf]


def test_an_earlier_download_of_a_plain_ply_is_still_read(tmp_path: Path) -> None:
    local = download(0.5, 1.5).model_copy(update={"form": "ply"})
    (group,) = groups(tmp_path, {"mode": "local-ply", "local": local})
    assert group.controller.title == "Local PLY"


def test_each_network_counts_the_same_if_it_has_the_controller(tmp_path: Path) -> None:
    found = groups(
        tmp_path,
        run("seen", "bus", "a", 40),
        run("seen", "bus", "a", 60),
        run("seen", "tram", "a", 110),
        run("latency", "bus", "a", 90),
        run("latency", "tram", "a", 90),
        run("seen", "bus", "a", 40, rtt_ms=300),
        run("l2a|\n", "tram", "a", 40),
    )
    latency, seen = found.overall()
    estimate = known(seen.estimate(AGE))
    assert (estimate.mean, estimate.low, estimate.high) == (80, 50, 110)
    assert (latency.labels, seen.labels) == (["all", "20", "Latency", "2"], ["all", "20", "Seen", "3"])
    first, _, row, *_ = overall_markdown([seen]).splitlines()
    assert first.startswith("| round trip, ms | controller | runs | View latency p95, ms |")
    assert row.startswith("| 20 | Seen | 3 | 80 | 80 | ")


def test_groups_of_one_network_have_the_same_blocks(tmp_path: Path) -> None:
    """Seen is the later one in every block, but was not measured in the hard ones."""
    hard = [run("latency", "bus", f"hard {number}", 200) for number in range(4)]
    easy = [run(name, "bus", f"{n}", ms) for n in range(4) for name, ms in (("latency", 40), ("seen", 50))]
    latency, seen = groups(tmp_path, *hard, *easy)
    assert [known(group.estimate(AGE)).mean for group in (latency, seen)] == [40, 50]
    left_out = (
        "Tables and figures leave out 4 of 12 runs, because not all controllers have runs of their blocks: "
        "Seen lacks 4."
    )
    assert left_out in collect_warnings(load_results(tmp_path))


def test_controllers_without_a_common_block_are_shown_with_a_warning(tmp_path: Path) -> None:
    assert len(groups(tmp_path, run("latency", "bus", "a", 40), run("seen", "bus", "b", 40))) == 2
    (warning,) = (
        each for each in collect_warnings(load_results(tmp_path)) if "no block has runs of all controllers" in each
    )
    assert warning.endswith("(Latency lacks 1, Seen lacks 1).")


def test_only_blocks_that_both_have_are_compared(tmp_path: Path) -> None:
    found = groups(
        tmp_path,
        run("latency", "bus", "a", 40),
        run("latency", "bus", "b", 400),
        run("l2a", "bus", "a", 60),
        run("l2a", "bus", "c", 900),
        run("seen", "tram", "a", 60),
    )
    (one,) = found.against(next(iter(found.looks)))
    estimate = known(one.estimate(AGE))
    assert (one.labels, estimate.mean, estimate.blocks) == (["bus", "20", "L2A", "1"], 20, 1)


def test_over_all_networks_nothing_is_said_of_a_figure_that_one_lacks(tmp_path: Path) -> None:
    found = groups(tmp_path, run("latency", "bus", "a", 40, reply_ms=30), run("latency", "tram", "a", 40))
    (total,) = found.overall()
    bus, tram = (each.estimate(RESPONSE) for each in total.networks)
    assert (known(bus).mean, tram, total.estimate(RESPONSE)) == (30, None, None)
    assert known(total.estimate(AGE)).mean == 40


def test_differences_over_all_networks_come_first(tmp_path: Path) -> None:
    found = groups(
        tmp_path,
        run("latency", "bus", "a", 40),
        run("latency", "tram", "a", 40),
        run("l2a", "bus", "a", 50),
        run("l2a", "tram", "a", 80),
        run("lol+", "tram", "a", 80),
    )
    compared = found.against(next(iter(found.looks)))
    names = [(each.condition.network, each.condition.controller.name) for each in compared]
    assert names == [("all", "l2a"), ("bus", "l2a"), ("tram", "lol+"), ("tram", "l2a")]
    estimate = known(compared[0].estimate(AGE))
    assert (estimate.mean, estimate.blocks) == (25, 2)


def test_the_baseline_is_the_first_of_the_file_unless_another_is_chosen(tmp_path: Path) -> None:
    runs = [run(each, "bus", "a", 40) for each in ("latency", 2, "l2a")]
    found = groups(tmp_path, *runs, run("lol+", "bus", "a", 40, reprojection=True, upscale="scene"))

    def chosen(plan: dict[str, object], asked: str | None = None) -> str:
        record = ExperimentRecord.model_validate({"name": "x", "created": "", "source": "page", "plan": plan})
        controller = choose_baseline(found, record, asked)
        assert controller is not None
        return controller.name

    file: dict[str, object] = {"modes": ["dash-tuned", "stateless"], "controllers": ["seen", 2, "l2a"]}
    assert chosen(file) == "profile-2", "there are no runs of those before it"
    assert chosen(file, "l2a") == "l2a"
    assert chosen(file | {"modes": ["stateless"], "controllers": ["lol+", 2]}) == "lol++scene+reprojection"
    assert chosen({"modes": "odd"}) == "latency"
    with pytest.raises(StartError, match="no runs of the controller 'bola', only of latency, lol\\+\\+scene"):
        chosen(file, "bola")
    assert choose_baseline(Groups.from_runs([]), None, None) is None


def test_a_caption_says_how_many_runs_a_mean_is_of(tmp_path: Path) -> None:
    one, two = groups(tmp_path, {}, {"controller": "seen"}, {"controller": "seen", "repeat": 1})

    assert [describe_run_counts([one]), describe_run_counts([one, one]), describe_run_counts([two])] == [
        "One run.",
        "One run each.",
        "Means over 2 runs, with their range.",
    ]
    found = groups(tmp_path / "other", {}, {"movement": "orbit"}, {"movement": "orbit", "repeat": 1})
    assert describe_run_counts([*found, one]) == "Means over 1 to 3 runs (2 movements), with their range."
