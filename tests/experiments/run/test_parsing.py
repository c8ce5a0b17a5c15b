"""Text forms of a run's parameters, and their meaning."""

from __future__ import annotations

from pathlib import Path

import pytest

from tigas_common.wire.shaper import LinkSetting
from tigas_experiments.run.parsing import parse_network, parse_viewport
from tigas_experiments.wire.run import Network
from tigas_shaper.traces.formats import trace_name


@pytest.mark.parametrize(
    ("text", "link"),
    [
        ("20mbit,20ms-rtt", LinkSetting(down_kbps=20_000, up_kbps=10_000, delay_ms=10)),
        ("1.5mbit,500kbit-up", LinkSetting(down_kbps=1500, up_kbps=500)),
        (
            "800kbit, 5mbit-up, 2ms-jitter, 0.5%-loss",
            LinkSetting(down_kbps=800, up_kbps=5000, jitter_ms=2, loss_pct=0.5),
        ),
    ],
)
def test_constant_links(text: str, link: LinkSetting) -> None:
    assert parse_network(text) == Network(link=link)


@pytest.mark.parametrize("text", ["٣x٣", "640×360", "640", "x", "9" * 5000 + "x1", "-1x1"])
def test_a_viewport_that_is_none_is_told(text: str) -> None:
    with pytest.raises(ValueError, match="is not WIDTHxHEIGHT") as told:
        parse_viewport(text)
    assert len(str(told.value)) < 200


def test_only_plain_digits_make_a_link() -> None:
    assert parse_network("٣mbit").link is None
    assert parse_network("bus,٣ms-rtt").rtt_ms is None


def test_traces_by_name_and_by_file(tmp_path: Path) -> None:
    path = tmp_path / "bus.json"
    path.touch()
    assert parse_network(str(path)) == Network(trace="bus.json", trace_file=path)
    assert parse_network("4g-bus") == Network(trace="4g-bus")
    assert parse_network("4g-bus,100ms-rtt") == Network(trace="4g-bus", rtt_ms=100)
    assert parse_network(f"{path},50ms-rtt") == Network(trace="bus.json", trace_file=path, rtt_ms=50)
    assert parse_network("20mbit,50ms-rtt").round_trip_ms == parse_network("4g-bus,50ms-rtt").round_trip_ms == 50
    assert not parse_network("unshaped").shaped


@pytest.mark.parametrize(
    "stem", ["5mbit", "5mbit-up", "800kbit-lte", "20ms-rtt", "2ms-jitter", "unshaped", "Verizon-LTE.down"]
)
def test_the_shapers_traces_have_names_of_no_other_network(stem: str) -> None:
    name = trace_name(f"{stem}.csv")
    assert name in (stem, f"trace-{stem}")
    assert parse_network(name) == Network(trace=name)


def test_a_file_s_path_is_relative_to_where_it_was_written(tmp_path: Path) -> None:
    (tmp_path / "bus.csv").touch()
    assert parse_network("bus.csv,20ms-rtt", tmp_path).trace_file == Path("bus.csv")
    (tmp_path / "20mbit.csv").touch()
    assert parse_network("20mbit.csv", tmp_path).trace_file == Path("20mbit.csv")


@pytest.mark.parametrize(
    "text",
    ["unshaped", "20mbit", "20mbit,20ms-rtt", "1.5mbit,0.5mbit-up,2ms-jitter,0.1%-loss,24.5ms-rtt", "4g-bus,0ms-rtt"],
)
def test_a_network_s_label_is_what_a_person_writes(text: str) -> None:
    assert parse_network(text).label == text


def test_the_same_rates_at_another_round_trip() -> None:
    for text in ("4g-bus", "20mbit,5ms-rtt,1%-loss", "20mbit"):
        assert parse_network(text).with_rtt(300).round_trip_ms == 300
    other = parse_network("20mbit,5ms-rtt,1%-loss").with_rtt(300)
    assert other == parse_network("20mbit,1%-loss,300ms-rtt")
    with pytest.raises(ValueError, match="the round trip of an unshaped network cannot be set"):
        parse_network("unshaped").with_rtt(20)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("20mbit,fast", "'fast' is not part of a link"),
        ("20ms-rtt,5ms-jitter", "has no rate"),
        ("20mbit,10mbit", "has mbit twice"),
        ("gone.csv", "there is no trace file 'gone.csv'"),
        ("../up/x", "there is no trace file"),
        ("20mbit,200%-loss", "less than or equal to 100"),
        ("", "at least 1 character"),
    ],
)
def test_nonsense_gets_a_sentence(text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        parse_network(text)
