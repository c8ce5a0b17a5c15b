"""A run's configuration: refusals, equality, and folder names."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import ValidationError

from tests.experiments.made_up import configuration
from tigas_common.wire.shaper import LinkSetting
from tigas_experiments.wire.run import DASH, LOCAL, MODE_NAMES, MODES, PER_VIEW, Configuration, Mode, Network


@pytest.mark.parametrize("network", [Network(), Network(link=LinkSetting(down_kbps=20_000, up_kbps=10_000))])
def test_only_a_trace_begins_elsewhere(network: Network) -> None:
    fields = network.model_dump() | {"offset_s": 5.0}
    with pytest.raises(ValidationError, match="only a trace can begin at another position"):
        Network.model_validate(fields)


LABELS = json.loads(Path(__file__).with_name("network_labels.golden.json").read_text())
LOSSY = LinkSetting(down_kbps=20_000, up_kbps=10_000, delay_ms=25, loss_pct=1)


@pytest.mark.parametrize(
    ("network", "name", "rtt"),
    [
        (Network(trace="4g-bus", rtt_ms=50.0), "4g-bus", 50.0),
        (Network(trace="4g-bus"), "4g-bus", None),
        (Network(link=LOSSY), "20mbit,1%-loss", 50.0),
        (Network(link=replace(LOSSY, down_kbps=800.0, up_kbps=0.0)), "0.8mbit,0mbit-up,1%-loss", 50.0),
        (Network(), "unshaped", None),
    ],
)
def test_a_network_s_name_leaves_out_its_round_trip(network: Network, name: str, rtt: float | None) -> None:
    assert (network.name, network.round_trip_ms) == (name, rtt)


@pytest.mark.parametrize("case", LABELS, ids=lambda case: case["label"])
def test_a_network_s_label_is_the_page_s(case: dict[str, Any]) -> None:
    """The page's tests read the same file."""
    network = Network.model_validate_json(json.dumps({name: case[name] for name in ("link", "trace", "rtt_ms")}))
    assert network.label == case["label"]


def test_every_mode_has_a_name_and_new_runs_have_all_but_the_earlier_ones() -> None:
    assert set(MODE_NAMES) == set(get_args(Mode))
    assert set(get_args(Mode)) - set(MODES) == {"local-ply"}
    assert {*PER_VIEW, *DASH, *LOCAL, "webrtc"} == set(get_args(Mode))


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"link": LOSSY, "trace": "4g-bus"}, "a constant link or a trace, not both"),
        ({"trace_file": Path("bus.csv")}, "needs the trace's name"),
        ({"link": LOSSY, "rtt_ms": 20.0}, "only a trace's round trip can be replaced"),
        ({"rtt_ms": 20.0}, "only a trace's round trip can be replaced"),
    ],
)
def test_a_network_is_one_thing(fields: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValidationError, match=sentence):
        Network.model_validate(fields)


def test_a_folder_that_moves_is_no_other_run() -> None:
    def walk(folder: str, name: str = "walk.csv", trace: str = "bus.csv", **changes: Any) -> Configuration:
        network = Network(trace=trace, trace_file=Path(folder, trace))
        return configuration(movement=f"{folder}/{name}", network=network, **changes)

    here = walk("walks")
    assert here.asks_for_the_same(walk("/elsewhere/walks"))
    for other in (walk("walks", "run.csv"), walk("walks", trace="tram.csv"), walk("walks", seed=2)):
        assert not here.asks_for_the_same(other)


def test_a_folder_name_is_safe_whatever_the_names() -> None:
    slug = configuration(scene="../../etc/passwd", movement="/a/b c.csv", network=Network(trace="x/../y")).slug
    assert slug == "etc-passwd_b-c_x-..-y_stateless-seen_0"
    assert "/" not in slug


def test_a_folder_says_which_models_enhanced_its_frames() -> None:
    plain = configuration().slug
    assert configuration(restore="off", upscale="off").slug == plain
    slugs = {
        configuration(restore=restore, upscale=upscale).slug
        for restore in ("off", "anime4k-restore-m")
        for upscale in ("off", "scene", "bicubic")
    }
    assert len(slugs) == 6
    assert plain.replace("_0", "_restore-anime4k-restore-m_upscale-scene_0") in slugs


def test_a_folder_says_how_movement_was_met_only_where_it_was() -> None:
    plain = configuration().slug
    assert configuration(overscan=0.1, depth=False, surround=False).slug == plain
    assert configuration(reprojection=True).slug == plain.replace("_0", "_reprojection_0")
    assert configuration(prediction="linear").slug == plain.replace("_0", "_prediction-linear_0")
    every = configuration(reprojection=True, overscan=0.1, depth=False, surround=False, prediction="linear").slug
    assert every == plain.replace("_0", "_reprojection_overscan-0.1_no-depth_no-surround_prediction-linear_0")


def test_a_run_of_a_predictor_that_is_gone_stays_readable() -> None:
    old = configuration().model_dump() | {"prediction": "auto"}
    assert Configuration.model_validate(old).motion == ("prediction-auto",)


@pytest.mark.parametrize("change", [{"overscan": 0.6}, {"overscan": "much"}, {"prediction": "Linear!"}])
def test_what_cannot_meet_movement_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        configuration(**change)


def test_the_longest_names_fit_into_a_file_system() -> None:
    long = "x" * 200
    models = {"restore": "r" * 24, "upscale": "u" * 24}
    network = Network(trace="t" * 100, rtt_ms=1e5)
    made = configuration(scene=long, movement=long, network=network, profile=long, segment=999, repeat=999)
    slug = made.model_copy(update=models).slug
    assert len(slug) < 250


@pytest.mark.parametrize("name", ["", "Off", "../x", "x" * 25, "a b", "ä"])
def test_what_cannot_be_a_model_is_told_in_a_sentence(name: str) -> None:
    with pytest.raises(ValidationError, match=r"is not the name of a model or predictor"):
        configuration(upscale=name)


def test_a_long_name_leaves_room_for_the_round_trip() -> None:
    network = Network(trace="t" * 100)
    assert configuration(network=network.with_rtt(20)).slug != configuration(network=network.with_rtt(200)).slug


@pytest.mark.parametrize("change", [{"duration_s": 0}, {"width": 1}, {"profile": -1}, {"duration_s": float("nan")}])
def test_absurd_configurations_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        configuration(**change)
