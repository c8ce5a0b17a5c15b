"""An experiment's file: the runs that follow from it, and one sentence for whatever is wrong with it."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from tigas_common.errors import StartError
from tigas_common.wire.run import Configuration
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.run.measure import page_settings
from tigas_experiments.run.plan import Plan, lasting, seconds

REPOSITORY = Path(__file__).parents[3]
SMALL: dict[str, Any] = {"name": "small", "scenes": ["courtyard"], "movements": ["stroll"], "networks": ["4g-bus"]}


def toml(**fields: Any) -> str:
    """A file; JSON's values are TOML's."""
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in {**SMALL, **fields}.items())


def runs(directory: Path, **fields: Any) -> list[Configuration]:
    """What follows from a file in a directory."""
    path = directory / "experiment.toml"
    path.write_text(toml(**fields))
    return Plan.read(path).runs(directory)


def test_everything_is_combined_and_repeats_go_outermost(tmp_path: Path) -> None:
    made = runs(
        tmp_path,
        networks=["4g-bus", "20mbit"],
        rtts_ms=[20, 300],
        modes=["stateless", "dash-tuned"],
        controllers=["latency", "lol+", "0"],
        repeats=3,
    )
    assert len(made) == 3 * 2 * 2 * (3 + 1), "controllers multiply the mode stateless only"
    assert [run.repeat for run in made] == [0] * 16 + [1] * 16 + [2] * 16
    assert [(run.mode, run.profile) for run in made[:4]] == [
        ("stateless", "latency"),
        ("stateless", "lol+"),
        ("stateless", 0),
        ("dash-tuned", "budget"),
    ]
    assert [run.network.round_trip_ms for run in made[:16:4]] == [20, 300, 20, 300]
    assert len({run.slug for run in made}) == len(made), "each has a folder of its own"
    assert {run.seed for run in made} == {1}, "a repeat has the same inputs"


def test_a_stream_has_the_frame_rate_that_the_file_asks_for_or_its_preset_has(tmp_path: Path) -> None:
    (chosen,) = runs(tmp_path, modes=["dash-edge"], dash_frame_rate=60)
    (left_out,) = runs(tmp_path, modes=["dash-edge"])
    assert (page_settings(chosen)["dashPreset"], page_settings(chosen)["dashFrameRate"]) == ("edge", 60)
    assert page_settings(left_out)["dashFrameRate"] is None


def test_paths_are_relative_to_the_file_and_traces_begin_where_it_says(tmp_path: Path, monkeypatch: Any) -> None:
    (tmp_path / "walk.csv").touch()
    (tmp_path / "bus.log").touch()
    monkeypatch.chdir("/")
    elsewhere = {"movements": ["walk.csv"], "networks": ["bus.log,50ms-rtt", "20mbit"], "trace_offset_s": 60}
    bus, constant = runs(tmp_path, **elsewhere)
    assert (bus.movement, bus.network.trace_file) == ("walk.csv", Path("bus.log")), "as a person named them"
    assert (bus.network.offset_s, bus.network.rtt_ms) == (60, 50)
    assert constant.network.offset_s == 0


def test_a_run_keeps_no_more_pictures_than_a_page_has_room_for(tmp_path: Path) -> None:
    def interval_ms(**fields: Any) -> float:
        (run,) = runs(tmp_path, **fields)
        return run.capture_every_ms

    assert interval_ms(duration_s=60, capture_every_s=0.01) == 500
    assert interval_ms(duration_s=60, capture_every_s=1) == 1000
    assert interval_ms(duration_s=60, capture_every_s=0) == 0


def test_dash_runs_do_not_change_with_the_controllers(tmp_path: Path) -> None:
    one, other = (runs(tmp_path, modes=["dash-tuned"], controllers=[name]) for name in ("latency", "l2a"))
    assert one == other


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"colour": 1}, "there is no 'colour', only name, scenes"),
        ({"scenes": []}, "scenes: there must be at least one"),
        ({"scenes": ["../../etc"]}, "scenes.0: '../../etc' must not be a path"),
        ({"scenes": "courtyard"}, "scenes: input should be"),
        ({"name": "a/b"}, "name: 'a/b' must not be a path"),
        ({"name": ".."}, "name: '..' must not be a path"),
        ({"name": ""}, "name: string should have at least 1"),
        ({"name": "  "}, "name: string should have at least 1"),
        ({"movements": ["gone.csv"]}, "There is no movement's file"),
        ({"networks": ["gone.csv"]}, "there is no trace file 'gone.csv'"),
        ({"networks": ["4g-bus", "4g-bus"]}, "networks: '4g-bus' is there twice"),
        ({"networks": ["20mbit,200%-loss"]}, "less than or equal to 100"),
        ({"networks": ["unshaped"], "rtts_ms": [20]}, "an unshaped network has the round trip"),
        ({"rtts_ms": [-1]}, "rtts_ms.0: input should be greater than or equal to 0"),
        ({"rtts_ms": []}, "rtts_ms: there must be at least one"),
        ({"modes": ["webrtc"]}, "modes.0: input should be"),
        ({"controllers": [-1]}, "The profile is a rung"),
        ({"controllers": [0, "0"]}, "0 is there twice"),
        ({"repeats": 0}, "repeats: input should be greater"),
        ({"repeats": True}, "repeats: input should be a valid integer"),
        ({"duration_s": 1e300}, "duration_s: input should be less than or equal to 7200"),
        ({"duration_s": "20"}, "duration_s: input should be a valid number"),
        ({"viewport": "big"}, "'big' is not WIDTHxHEIGHT"),
        ({"viewport": "1x1"}, "width: input should be greater"),
        ({"warm_up_s": -1}, "warm_up_s: input should be greater"),
        ({"trace_offset_s": -1}, "trace_offset_s: input should be greater"),
        ({"repeats": 1000, "rtts_ms": list(range(20))}, "would have 20000 runs; the limit is 10000"),
        ({"repeats": 1000, "duration_s": 7200}, "would take 83 days"),
        ({"scenes": ["a b", "a-b"]}, "'a b' and 'a-b' would get the same folders"),
    ],
)
def test_nonsense_gets_one_sentence(tmp_path: Path, fields: dict[str, Any], sentence: str) -> None:
    with pytest.raises(StartError) as error:
        runs(tmp_path, **fields)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"duration_s = nan", "duration_s: input should be a finite number"),
        (b"duration_s = inf", "duration_s: input should be a finite number"),
        (b"name = 1999-01-01T00:00:00Z\nname = 2", "is no TOML"),
        (b"= 1", "is no TOML"),
        (b"\xff", "is no TOML"),
        (b"#" * 200_000, "more than 100000 bytes"),
        (b"", "name: field required"),
        (None, "cannot be read: No such file"),
    ],
)
def test_what_is_no_experiment(tmp_path: Path, content: bytes | None, sentence: str) -> None:
    path = tmp_path / "experiment.toml"
    if content is not None:
        path.write_bytes(toml().encode() + content if content.startswith(b"duration") else content)
    with pytest.raises(StartError, match=sentence):
        Plan.read(path)


def test_two_movements_of_one_name_are_refused(tmp_path: Path) -> None:
    for site in ("a", "b"):
        (tmp_path / site).mkdir()
        (tmp_path / site / "user1.csv").touch()
    with pytest.raises(StartError, match="would get the same folders"):
        runs(tmp_path, movements=["a/user1.csv", "b/user1.csv"])


def test_how_long_it_takes(tmp_path: Path) -> None:
    made = runs(tmp_path, duration_s=55, warm_up_s=5, repeats=60)
    assert 3600 < seconds(made) < 4000
    assert lasting(made).startswith("1:0")


@pytest.mark.parametrize("path", sorted((REPOSITORY / "experiments").glob("*.toml")), ids=lambda path: path.name)
def test_the_experiments_that_come_along_can_be_made(path: Path) -> None:
    made = Plan.read(path).runs(path.parent)
    networks = [Inputs(path.parent).network(run.network) for run in made]
    assert all(network.trace_file is None or network.trace_file.is_file() for network in networks)
    if path.name == "paper.toml":
        assert {run.network.round_trip_ms for run in made} == {20, 50, 100, 200, 300}
        assert len({run.network.name for run in made}) == 4
        assert set(Counter((run.mode, run.profile) for run in made).values()) == {4 * 5 * 2 * 3}
