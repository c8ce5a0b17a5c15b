"""An experiment's file: its runs, and one sentence for any fault."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from tigas_common.errors import StartError
from tigas_experiments.commands.paper import Evaluation
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.run.job import page_settings
from tigas_experiments.run.plan import ExperimentPlan, estimate_seconds, format_duration
from tigas_experiments.wire.run import Configuration

REPOSITORY = Path(__file__).parents[3]
EXPERIMENTS = REPOSITORY / "experiments"
SMALL: dict[str, Any] = {"name": "small", "scenes": ["courtyard"], "movements": ["stroll"], "networks": ["4g-bus"]}


def toml(**fields: Any) -> str:
    return "".join(f"{key} = {_value(value)}\n" for key, value in {**SMALL, **fields}.items())


def _value(value: Any) -> str:
    """JSON's values are TOML's, but for tables."""
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_value(own)}' for key, own in value.items())} }}"
    return json.dumps(value)


def runs(directory: Path, **fields: Any) -> list[Configuration]:
    """The plan of a file in a directory."""
    path = directory / "experiment.toml"
    path.write_text(toml(**fields))
    return ExperimentPlan.read(path).runs(directory)


def test_everything_is_combined_and_repeats_go_outermost(tmp_path: Path) -> None:
    made = runs(
        tmp_path,
        networks=["4g-bus", "20mbit"],
        rtts_ms=[20, 300],
        modes=["stateless", "dash-tuned"],
        controllers=["latency", "lol+", "0"],
        repeats=3,
        shuffled=False,
    )
    assert len(made) == 3 * 2 * 2 * (3 + 1), "controllers multiply the mode stateless only"
    assert [run.repeat for run in made] == [0] * 16 + [1] * 16 + [2] * 16
    assert [(run.mode, run.profile) for run in made[:4]] == [
        ("stateless", "latency"),
        ("stateless", "lol+"),
        ("stateless", 0),
        ("dash-tuned", "seen"),
    ]
    assert [run.network.round_trip_ms for run in made[:16:4]] == [20, 300, 20, 300]
    assert len({run.slug for run in made}) == len(made), "each has a folder of its own"
    assert {run.seed for run in made} == {1}, "a repeat has the same inputs"


def test_the_mode_video_has_the_controllers_of_the_mode_stateless_and_no_samples(tmp_path: Path) -> None:
    made = runs(tmp_path, modes=["video", "stateless"], controllers=["seen", "1"], sample_stride=5, shuffled=False)
    assert [(run.mode, run.profile, run.sample_stride) for run in made] == [
        *(("video", "seen", 0), ("video", 1, 0), ("stateless", "seen", 5), ("stateless", 1, 5))
    ]
    assert len({run.slug for run in made}) == len(made)
    assert {"mode": "video", "controller": "seen"}.items() <= page_settings(made[0]).items()
    assert {"mode": "video", "controller": "fixed", "profile": 1}.items() <= page_settings(made[1]).items()


def test_the_order_is_random_but_by_the_seed_alone_and_compares_what_is_close_in_time(tmp_path: Path) -> None:
    fields: dict[str, Any] = {
        "networks": ["4g-bus", "20mbit"],
        "rtts_ms": [20, 50, 300],
        "controllers": ["latency", "lol+", "l2a"],
        "repeats": 2,
    }
    listed, made, again, other = (
        runs(tmp_path, **fields, **more) for more in ({"shuffled": False}, {}, {}, {"seed": 2})
    )
    assert made == again, "a resumed experiment goes on in the same order"
    assert [run.slug for run in made] != [run.slug for run in other]
    assert sorted(run.slug for run in made) == sorted(run.slug for run in listed)
    assert [run.repeat for run in made] == [0] * 18 + [1] * 18, "an interrupted one has as many of each"
    blocks = [made[first : first + 3] for first in range(0, 36, 3)]
    assert all(len({run.network.label for run in block}) == 1 for block in blocks)
    assert len({tuple(run.profile for run in block) for block in blocks}) > 2, "no controller is always the first"


def traces(directory: Path, *, seconds: int = 180) -> dict[str, Any]:
    """Fields of an experiment with a recorded network and a recorded movement of 60 s."""
    (directory / "bus.csv").write_text(f"t_ms,down_kbps,up_kbps,delay_ms\n0,1,1,1\n{seconds}000,,,\n")
    poses = "".join(f"{t},{t / 1000},0,0,0,0,0,1\n" for t in range(0, 60_001, 20))
    (directory / "walk.csv").write_text(f"t_ms,x,y,z,qx,qy,qz,qw\n{poses}")
    return {"networks": ["bus.csv"], "movements": ["walk.csv"], "rtts_ms": [20, 50], "duration_s": 8}


@pytest.mark.parametrize(
    ("content", "lasts_s"),
    [
        ("t_ms,down_kbps\n0,1\n20000,2\n30000,\n", 30),
        ("t_ms,down_kbps\n0,1\n20000,2\n", 40),
        ("\ndown_kbps,\tt_ms\n1, 0\n2, 24000\n", 48),
        ("t_ms,down_kbps\n0,1\n", 1),
    ],
    ids=["with an end", "without one", "columns in another order", "one row"],
)
def test_segments_fill_a_trace_as_long_as_the_shaper_plays_it(tmp_path: Path, content: str, lasts_s: int) -> None:
    fields = traces(tmp_path)
    (tmp_path / "bus.csv").write_text(content)
    with pytest.raises(StartError, match=f"has room for {lasts_s // 8} segments of 8 s"):
        runs(tmp_path, **fields, segments=9)


def test_segments_are_different_parts_of_traces_and_movements(tmp_path: Path) -> None:
    fields = {**traces(tmp_path), "segments": 6, "trace_offset_s": 60, "controllers": ["latency", "l2a"]}
    made = runs(tmp_path, **fields)
    assert len(made) == 6 * 2 * 2
    assert len({run.slug for run in made}) == len(made)
    pairs = {(run.segment, run.network.offset_s, run.movement_offset_s) for run in made}
    assert len(pairs) == 6, "alike for each controller and round trip"
    for offsets, first, last in (({pair[1] for pair in pairs}, 60, 180), ({pair[2] for pair in pairs}, 0, 60)):
        ordered = sorted(offsets)
        assert first <= ordered[0]
        assert ordered[-1] + 8 <= last
        assert all(b - a >= 7.998 for a, b in pairwise(ordered)), "none overlap"
    assert made == runs(tmp_path, **fields)
    other = runs(tmp_path, **fields, seed=2)
    assert {run.network.offset_s for run in other}.isdisjoint(pair[1] for pair in pairs)


def test_movements_take_turns_over_the_parts_of_traces(tmp_path: Path) -> None:
    fields = {**traces(tmp_path), "segments": 6, "controllers": ["latency", "l2a"], "movements_in_turn": True}
    shutil.copy(tmp_path / "bus.csv", tmp_path / "tram.csv")
    shutil.copy(tmp_path / "walk.csv", tmp_path / "other.csv")
    made = runs(tmp_path, **{**fields, "networks": ["bus.csv", "tram.csv"], "movements": ["walk.csv", "other.csv"]})
    assert len(made) == 2 * 6 * 2 * 2, "as many as with one movement"
    people = {(run.network.name, run.segment): run.movement for run in made}
    assert all(run.movement == people[run.network.name, run.segment] for run in made), "alike for all controllers"
    for network in ("bus.csv", "tram.csv"):
        assert Counter(person for (name, _), person in people.items() if name == network) == {
            "walk.csv": 3,
            "other.csv": 3,
        }
    assert people["bus.csv", 0] != people["tram.csv", 0]


def test_a_short_movement_has_segments_that_overlap_and_a_generated_one_is_long_enough(tmp_path: Path) -> None:
    fields = {**traces(tmp_path), "duration_s": 25, "segments": 4}
    made = runs(tmp_path, **{**fields, "movements": ["walk.csv", "stroll"]})
    walk, stroll = (
        sorted({run.movement_offset_s for run in made if run.movement == name}) for name in ("walk.csv", "stroll")
    )
    assert walk == pytest.approx([0, 35 / 3, 70 / 3, 35], abs=0.001)
    assert stroll == [0, 25, 50, 75]


def test_a_constant_link_has_segments_of_the_movement_alone(tmp_path: Path) -> None:
    made = runs(tmp_path, **{**traces(tmp_path), "networks": ["20mbit"], "segments": 3})
    assert {run.network.offset_s for run in made} == {0}
    assert len({run.movement_offset_s for run in made}) == 3


def test_a_stream_has_the_frame_rate_that_the_file_asks_for_or_its_preset_has(tmp_path: Path) -> None:
    (chosen,) = runs(tmp_path, modes=["dash-edge"], dash_frame_rate=60)
    (left_out,) = runs(tmp_path, modes=["dash-edge"])
    assert (page_settings(chosen)["dashPreset"], page_settings(chosen)["dashFrameRate"]) == ("edge", 60)
    assert page_settings(left_out)["dashFrameRate"] is None


def test_dash_plays_single_representations_beside_all_of_them(tmp_path: Path) -> None:
    every = ["adaptive", "r3-500", "r2-4242"]
    made = runs(tmp_path, modes=["stateless", "dash-tuned"], dash_representations=every, shuffled=False)
    assert [page_settings(run).get("dashRepresentation", "none") for run in made] == [
        "none",
        None,
        {"rung": 3, "bitrate_kbps": 500},
        {"rung": 2, "bitrate_kbps": 4242},
    ]
    assert [run.slug.split("_")[3] for run in made[1:]] == ["dash-tuned", "dash-tuned-r3-500", "dash-tuned-r2-4242"]


def test_dash_alone_is_played_over_each_transport(tmp_path: Path) -> None:
    made = runs(tmp_path, modes=["stateless", "dash-edge", "webrtc"], dash_transports=["tcp", "h3"], shuffled=False)
    assert [page_settings(run).get("dashTransport") for run in made] == [None, "tcp", "h3", None]
    assert [run.slug.split("_")[3] for run in made[1:]] == ["dash-edge", "dash-edge-h3", "webrtc"]


def test_local_runs_download_the_scene_and_change_with_nothing_that_the_server_renders(tmp_path: Path) -> None:
    several = {"controllers": ["latency", "l2a"], "dash_representations": ["r3-500"], "reprojection": [True, False]}
    made = runs(tmp_path, modes=["local-compressed", "local-streamed", "stateless"], **several, shuffled=False)
    made, others = made[:2], made[2:]
    assert [run.local for run in made] == [True, True]
    assert [page_settings(run)["localForm"] for run in made] == ["compressed", "streamed"]
    assert not any(run.local for run in others)
    assert {page_settings(run)["mode"] for run in made} == {"stateless"}, "until the run begins"
    assert not any(run.reprojection for run in made)


def test_a_stream_over_webrtc_needs_the_packager_and_has_one_codec(tmp_path: Path) -> None:
    fields: dict[str, Any] = {
        "modes": ["webrtc"],
        "controllers": ["latency", "seen"],
        "dash_representations": ["adaptive", "r3-500"],
    }
    (made,) = runs(tmp_path, **fields)
    assert made.streamed
    assert {"mode": "webrtc", "webrtcStream": "h264-30"}.items() <= page_settings(made).items()


def test_paths_are_relative_to_the_file_and_traces_begin_where_it_says(tmp_path: Path, monkeypatch: Any) -> None:
    (tmp_path / "walk.csv").touch()
    (tmp_path / "bus.log").touch()
    monkeypatch.chdir("/")
    elsewhere = {"movements": ["walk.csv"], "networks": ["bus.log,50ms-rtt", "20mbit"], "trace_offset_s": 60}
    elsewhere["shuffled"] = False
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


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"colour": 1}, "unknown key 'colour'; the keys are name, scenes"),
        ({"scenes": []}, "scenes: there must be at least one"),
        ({"scenes": ["../../etc"]}, "scenes.0: '../../etc' must not be a path"),
        ({"scenes": "courtyard"}, "scenes: input should be"),
        ({"name": "a/b"}, "name: 'a/b' must not be a path"),
        ({"name": ".."}, "name: '..' must not be a path"),
        ({"name": ""}, "name: string should have at least 1"),
        ({"name": "  "}, "name: string should have at least 1"),
        ({"movements": ["gone.csv"]}, "There is no movement file"),
        ({"networks": ["gone.csv"]}, "there is no trace file 'gone.csv'"),
        ({"networks": ["4g-bus", "4g-bus"]}, "networks: '4g-bus' occurs twice"),
        ({"networks": ["20mbit,200%-loss"]}, "less than or equal to 100"),
        ({"networks": ["unshaped"], "rtts_ms": [20]}, "the round trip of an unshaped network cannot be set"),
        ({"rtts_ms": [-1]}, "rtts_ms.0: input should be greater than or equal to 0"),
        ({"rtts_ms": []}, "rtts_ms: there must be at least one"),
        ({"modes": ["rtsp"]}, "modes.0: input should be"),
        ({"prediction": "auto"}, "prediction.0: input should be 'off', 'velocity' or 'linear'"),
        ({"modes": ["local-ply"]}, "the mode 'local-ply' was removed; use 'local-compressed'."),
        ({"variants": [{"modes": ["local-ply"]}]}, "variants.0.modes.0: the mode 'local-ply' was removed"),
        ({"controllers": [-1]}, "The profile is a rung"),
        ({"controllers": [0, "0"]}, "0 occurs twice"),
        ({"repeats": 0}, "repeats: input should be greater"),
        ({"repeats": True}, "repeats: input should be a valid integer"),
        ({"duration_s": 1e300}, "duration_s: input should be less than or equal to 7200"),
        ({"duration_s": "20"}, "duration_s: input should be a valid number"),
        ({"viewport": "big"}, "'big' is not WIDTHxHEIGHT"),
        ({"viewport": "1x1"}, "width: input should be greater"),
        ({"warm_up_s": -1}, "warm_up_s: input should be greater"),
        ({"trace_offset_s": -1}, "trace_offset_s: input should be greater"),
        ({"repeats": 1000, "rtts_ms": list(range(20))}, "would have 20000 runs; the limit is 10000"),
        ({"repeats": 1000, "duration_s": 7200}, "would take 83.4 days"),
        ({"scenes": ["a b", "a-b"]}, "'a b' and 'a-b' would get the same folders"),
        ({"sample_stride": -1}, "sample_stride"),
        ({"segments": 0}, "segments: input should be greater"),
        ({"segments": 23}, "bus.csv has room for 22 segments of 8 s from 0 s on, not 23."),
        ({"segments": 2, "trace_offset_s": 200}, "bus.csv has room for 0 segments of 8 s from 200 s on, not 2."),
        ({"segments": 2, "networks": ["4g-bus"]}, "Segments need the trace's file, so '4g-bus' must be a path."),
        ({"segments": 2, "networks": ["walk.csv"]}, "walk.csv is not a TIGAS trace"),
        ({"segments": 2, "movements": ["bus.csv"]}, "bus.csv"),
        ({"segments": 2, "duration_s": 61}, "The movement walk.csv lasts 60.0 s, less than a run's 61 s."),
        ({"upscale": "Scene!"}, "upscale: 'Scene!' is not the name of a model or predictor."),
        ({"variants": [{"scenes": ["room"]}]}, "variants"),
        *(({"dash_representations": [odd]}, "representation") for odd in ("2-500", "r2", "r2-5", "r300-500")),
    ],
)
def test_nonsense_gets_one_sentence(tmp_path: Path, fields: dict[str, Any], sentence: str) -> None:
    recorded = traces(tmp_path) if "segments" in fields else {}
    with pytest.raises(StartError) as error:
        runs(tmp_path, **{**recorded, **fields})
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"duration_s = nan", "duration_s: input should be a finite number"),
        (b"duration_s = inf", "duration_s: input should be a finite number"),
        (b"name = 1999-01-01T00:00:00Z\nname = 2", "is not TOML"),
        (b"= 1", "is not TOML"),
        (b"\xff", "cannot be read"),
        (b"#" * 200_000, "more than 100,000 characters"),
        (b"", "name: field required"),
        (None, "cannot be read: No such file"),
    ],
)
def test_what_is_no_experiment(tmp_path: Path, content: bytes | None, sentence: str) -> None:
    path = tmp_path / "experiment.toml"
    if content is not None:
        path.write_bytes(toml().encode() + content if content.startswith(b"duration") else content)
    with pytest.raises(StartError, match=sentence):
        ExperimentPlan.read(path)


def test_two_movements_of_one_name_are_refused(tmp_path: Path) -> None:
    for site in ("a", "b"):
        (tmp_path / site).mkdir()
        (tmp_path / site / "user1.csv").touch()
    with pytest.raises(StartError, match="would get the same folders"):
        runs(tmp_path, movements=["a/user1.csv", "b/user1.csv"])


def test_how_long_it_takes(tmp_path: Path) -> None:
    made = runs(tmp_path, duration_s=55, warm_up_s=5, repeats=60)
    assert 3600 < estimate_seconds(made) < 4000
    assert format_duration(made) == "62 minutes"
    assert format_duration(made[:1]) == "62 seconds"
    assert format_duration(made * 2) == "2.1 hours"
    assert format_duration(made * 60) == "2.6 days"


def test_comparing_pictures_takes_time_too(tmp_path: Path) -> None:
    plain, small, large = (
        estimate_seconds(runs(tmp_path, duration_s=15, **more))
        for more in (
            {},
            {"capture_every_s": 1, "viewport": "480x270"},
            {"capture_every_s": 1, "viewport": "1280x720"},
        )
    )
    assert plain < small < large
    assert large - plain > 10, "fifteen pictures at 720p, about a second each"


def plans() -> dict[str, ExperimentPlan]:
    """The experiments that come along, by name: files, and the parts of the published evaluation."""
    evaluation = Evaluation.read(EXPERIMENTS / "paper.toml")
    parts = {part.name: evaluation.plan(part) for part in evaluation.parts}
    files = {path.stem: ExperimentPlan.read(path) for path in EXPERIMENTS.glob("*.toml") if path.stem != "paper"}
    return files | {name: plan for name, plan in parts.items() if plan is not None}


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """Their directory, where something stands in for the recordings that do not come along."""
    shutil.copytree(REPOSITORY / "traces", tmp_path / "traces")
    (tmp_path / "experiments" / "recorded").mkdir(parents=True)
    for plan in plans().values():
        for names, source in ((plan.networks, "network/4g-bus.csv"), (plan.movements, "movement/stroll.csv")):
            for name in names:
                if name.startswith("recorded/"):
                    shutil.copy(REPOSITORY / "traces" / source, tmp_path / "experiments" / name)
    return tmp_path / "experiments"


@pytest.mark.parametrize("name", plans())
def test_the_experiments_that_come_along_can_be_made(directory: Path, name: str) -> None:
    plan = plans()[name]
    made = plan.runs(directory)
    networks = [Inputs(directory).network(run.network) for run in made]
    assert all(network.trace_file is None or network.trace_file.is_file() for network in networks)
    assert plan.ladder == ("paper" if name in ("abr-rtt", "rtt", "quality", "enhancement") else "scene")
    blocks = {(run.network.name, run.segment, run.scene, run.movement) for run in made}
    assert len(blocks) >= (1 if name in ("quick", "motivation") else 6)


def test_parts_of_the_evaluation_are_as_long_as_they_say_and_cover_windows_and_people(directory: Path) -> None:
    for part in Evaluation.read(EXPERIMENTS / "paper.toml").parts:
        assert part.minutes <= 120
        if part.experiment is None:
            continue
        made = plans()[part.name].runs(directory)
        assert estimate_seconds(made) / 60 <= part.minutes, part.name
        windows = {(run.network.name, run.network.offset_s) for run in made}
        if part.name in ("rivals-near-far", "quality"):
            assert len(windows) == 12
        elif part.name.startswith(("controllers", "rivals")):
            assert (len(windows), len({run.movement for run in made})) == (24, 6)


def test_models_enhance_what_is_stateless(tmp_path: Path) -> None:
    plain, streamed = runs(tmp_path, modes=["stateless", "dash-edge"], shuffled=False)
    assert (plain.restore, plain.upscale) == ("off", "off")
    chosen, other = runs(
        tmp_path, modes=["stateless", "dash-edge"], shuffled=False, restore="anime4k-restore-m", upscale="scene"
    )
    assert (page_settings(chosen)["restore"], page_settings(chosen)["upscale"]) == ("anime4k-restore-m", "scene")
    assert other == streamed
    assert page_settings(other)["upscale"] == "off"


def test_reprojection_and_prediction_can_be_compared_in_every_mode(tmp_path: Path) -> None:
    (plain,) = runs(tmp_path)
    assert (plain.reprojection, plain.prediction) == (False, "off")
    assert (plain.overscan, plain.depth, plain.surround) == ("auto", True, True)
    made = runs(
        tmp_path,
        modes=["stateless", "dash-edge"],
        reprojection=[False, True],
        prediction=["off", "linear"],
        overscan=0.1,
        depth=False,
    )
    assert len(made) == len({run.slug for run in made}) == 8
    assert {(run.mode, run.reprojection, run.prediction) for run in made} == {
        (mode, reprojection, prediction)
        for mode in ("stateless", "dash-edge")
        for reprojection in (False, True)
        for prediction in ("off", "linear")
    }
    chosen = {"reprojection": True, "prediction": "linear", "overscan": 0.1, "depth": False, "surround": False}
    (one,) = runs(tmp_path, **chosen)
    assert chosen.items() <= page_settings(one).items()


def test_variants_are_compared_where_it_is_no_product(tmp_path: Path) -> None:
    made = runs(
        tmp_path,
        seed=3,
        depth=False,
        variants=[
            {"controllers": ["seen", 2]},
            {"controllers": [2], "reprojection": True, "prediction": "linear"},
            {"controllers": [2], "reprojection": True, "prediction": "linear", "surround": False},
            {"controllers": [2]},
        ],
        shuffled=False,
    )
    assert [(run.profile, run.reprojection, run.prediction, run.depth, run.surround) for run in made] == [
        ("seen", False, "off", False, True),
        (2, False, "off", False, True),
        (2, True, "linear", False, True),
        (2, True, "linear", False, False),
    ], "each once"


def test_variants_may_have_modes_of_their_own(tmp_path: Path) -> None:
    variants = [{"modes": ["stateless"], "controllers": ["latency"]}, {"modes": ["video", "local-compressed"]}]
    made = runs(tmp_path, modes=["dash-edge"], variants=variants, shuffled=False)
    assert [(run.mode, run.profile) for run in made] == [
        ("stateless", "latency"),
        ("video", "seen"),
        ("local-compressed", "seen"),
    ]


def test_frames_are_sampled_where_each_is_asked_for(tmp_path: Path) -> None:
    made = runs(tmp_path, modes=["stateless", "dash-edge"], shuffled=False, sample_stride=30)
    assert [run.sample_stride for run in made] == [30, 0]
