"""What a person writes, and what becomes of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from tests.experiments.made_up import configuration
from tigas_experiments.records.configuration import Configuration, ConstantLink, Network


@pytest.mark.parametrize(
    ("text", "link"),
    [
        ("20mbit,20ms-rtt", ConstantLink(down_kbps=20_000, up_kbps=10_000, delay_ms=10)),
        ("1.5mbit,500kbit-up", ConstantLink(down_kbps=1500, up_kbps=500)),
        (
            "800kbit, 5mbit-up, 2ms-jitter, 0.5%-loss",
            ConstantLink(down_kbps=800, up_kbps=5000, jitter_ms=2, loss_pct=0.5),
        ),
    ],
)
def test_constant_links(text: str, link: ConstantLink) -> None:
    assert Network.parse(text) == Network(name=text, link=link)


def test_traces_by_name_and_by_file(tmp_path: Path) -> None:
    path = tmp_path / "bus.json"
    path.touch()
    assert Network.parse(str(path)) == Network(name="bus.json", trace_file=path)
    assert Network.parse("4g-bus") == Network(name="4g-bus")
    assert Network.parse("4g-bus,100ms-rtt") == Network(name="4g-bus", rtt_ms=100)
    assert Network.parse(f"{path},50ms-rtt") == Network(name="bus.json", trace_file=path, rtt_ms=50)
    assert Network.parse("20mbit,50ms-rtt").round_trip_ms == Network.parse("4g-bus,50ms-rtt").round_trip_ms == 50
    assert not Network.parse("unshaped").shaped


def test_a_file_s_path_is_relative_to_where_it_was_written(tmp_path: Path) -> None:
    (tmp_path / "bus.csv").touch()
    assert Network.parse("bus.csv,20ms-rtt", tmp_path).trace_file == Path("bus.csv")


def test_the_same_rates_at_another_round_trip() -> None:
    for text in ("4g-bus", "20mbit,5ms-rtt,1%-loss", "20mbit"):
        assert Network.parse(text).with_rtt(300).round_trip_ms == 300
    other = Network.parse("20mbit,5ms-rtt,1%-loss").with_rtt(300)
    assert other == Network.parse("20mbit,1%-loss,300ms-rtt"), "its name says it, too"
    with pytest.raises(ValueError, match="has the round trip that it has"):
        Network.parse("unshaped").with_rtt(20)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("20mbit,fast", "'fast' is no part of a link"),
        ("20ms-rtt,5ms-jitter", "says no rate"),
        ("20mbit,10mbit", "says mbit twice"),
        ("gone.csv", "there is no trace file 'gone.csv'"),
        ("../up/x", "there is no trace file"),
        ("20mbit,200%-loss", "less than or equal to 100"),
        ("", "at least 1 character"),
    ],
)
def test_nonsense_gets_a_sentence(text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Network.parse(text)


@pytest.mark.parametrize("name", ["unshaped", "20mbit"])
def test_only_a_trace_begins_elsewhere(name: str) -> None:
    fields = Network.parse(name).model_dump() | {"offset_s": 5.0}
    with pytest.raises(ValidationError, match="only a trace can begin at another position"):
        Network.model_validate(fields)


def test_a_folder_that_moves_is_no_other_run() -> None:
    def walk(folder: str, name: str = "walk.csv", trace: str = "bus.csv", **changes: object) -> Configuration:
        network = Network(name=trace, trace_file=Path(folder, trace))
        return configuration(movement=f"{folder}/{name}", network=network, **changes)

    here = walk("walks")
    assert here.asks_for_the_same(walk("/elsewhere/walks"))
    for other in (walk("walks", "run.csv"), walk("walks", trace="tram.csv"), walk("walks", seed=2)):
        assert not here.asks_for_the_same(other)


def test_a_folder_name_is_safe_whatever_the_names() -> None:
    slug = configuration(scene="../../etc/passwd", movement="/a/b c.csv", network=Network(name="x/../y")).slug
    assert slug == "etc-passwd_b-c_x-..-y_stateless-budget_0"
    assert "/" not in slug


def test_a_long_name_leaves_room_for_the_round_trip() -> None:
    network = Network(name="t" * 100)
    assert configuration(network=network.with_rtt(20)).slug != configuration(network=network.with_rtt(200)).slug


@pytest.mark.parametrize("change", [{"duration_s": 0}, {"width": 1}, {"profile": -1}, {"duration_s": float("nan")}])
def test_absurd_configurations_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        configuration(**change)
