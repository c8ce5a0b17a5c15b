"""`tigas scene ladder`: the hull of the measurements, the rungs on it, and a ladder.json that the service takes."""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest

from reference.ply import write_ply
from tests.command import Result, tigas
from tests.render.ladder.test_measure import cloud
from tests.render.scenes import plys
from tigas_common.errors import StartError
from tigas_render.ladder.make import choose_rungs, find_scene, ladder_path, lower_hull, make_ladder, psnr_at, to_rung
from tigas_render.ladder.measure import Point
from tigas_render.scenes.directory import read_source


def point(kb: float, mse: float, width: int = 640, quality: int = 50) -> Point:
    return Point(width, width * 9 // 16, quality, kb, mse)


POINTS = [
    point(width / 100 * quality**0.5, 1e5 / (width / 100 * quality**0.5) ** 1.2 + 2 * abs(quality - 60), width, quality)
    for width in (256, 416, 640, 832, 960, 1120, 1280)
    for quality in range(10, 95, 5)
]
"""Error falls with bytes, least at one quality."""


def test_the_hull_has_no_setting_that_a_mixture_of_others_beats() -> None:
    good = [point(1, 100), point(2, 50), point(4, 20)]
    beaten = [point(3, 45), point(2, 60), point(5, 20), point(6, 30)]
    assert lower_hull([*beaten, *good]) == good


def test_the_hull_gives_what_a_mixture_of_its_neighbours_does() -> None:
    best = lower_hull([point(1, 100), point(2, 50)])
    assert psnr_at(best, 1.5) == pytest.approx(10 * math.log10(255**2 / 75))
    assert psnr_at(best, 2) == pytest.approx(best[-1].psnr_db)


@pytest.mark.parametrize("number", [8, 10, 16])
def test_rungs_go_from_the_best_to_the_smallest_without_a_jump(number: int) -> None:
    ladder = choose_rungs(POINTS, number)
    best = lower_hull(POINTS)
    assert len(ladder) == number
    assert (ladder[0], ladder[-1]) == (to_rung(best[-1]), to_rung(best[0]))
    whole = math.log(best[-1].kb / best[0].kb)
    for better, worse in pairwise(ladder):
        assert worse.expected_kb < better.expected_kb
        assert (worse.psnr_db or 0) < (better.psnr_db or 0)
        assert worse.width <= better.width
        assert math.log(better.expected_kb / worse.expected_kb) < 2 * whole / (number - 1)
    assert len({one.name for one in ladder}) == number


def test_few_settings_give_few_rungs() -> None:
    assert [one.name for one in choose_rungs([point(1, 9, 256), point(2, 4, 640, 85)], 10)] == [
        "640×360 q85",
        "256×144 q50",
    ]


def test_a_rung_never_has_more_pixels_than_a_better_one() -> None:
    points = [point(8, 1, 640), point(4, 2, 1280), point(2, 4, 640, 40), point(1, 9, 256)]
    assert [one.width for one in choose_rungs(points, 4)] == [640, 640, 256]


def test_a_folder_goes_before_a_built_in_scene_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_scene("courtyard").folder is None
    plys.write(tmp_path / "courtyard" / "scene.ply", plys.binary_ply())
    source = find_scene("courtyard")
    assert source.folder == tmp_path / "courtyard"
    assert ladder_path(source) == tmp_path / "courtyard" / "ladder.json"


def test_what_is_no_scene_gets_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(StartError, match=r"'nowhere' is neither .* \(courtyard\)"):
        find_scene("nowhere")
    with pytest.raises(StartError, match=r"no \.ply"):
        find_scene(str(tmp_path))
    with pytest.raises(StartError, match="--out"):
        ladder_path(find_scene("courtyard"))


@pytest.mark.slow
def test_the_command_writes_a_ladder_that_the_service_takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "cloud"
    folder.mkdir()
    write_ply(folder / "cloud.ply", cloud())
    (folder / "ladder.json").write_text("broken")

    monkeypatch.setattr("tigas_render.ladder.make.make_ladder", partial(make_ladder, rungs=8, views=1))

    def run(*options: object) -> Result:
        return tigas("scene", "ladder", folder, *options)

    refused = run("--plot", tmp_path / "plot.gif")
    assert refused.exit_code == 1
    assert refused.stderr.splitlines()[-1] == f"{tmp_path}/plot.gif must end in .png or .svg."
    done = run("--plot", tmp_path / "plot.svg")
    assert done.exit_code == 0, done.stderr
    ladder = read_source(folder).ladder
    assert ladder is not None
    assert 2 <= len(ladder) <= 8
    assert all(rung.psnr_db is not None for rung in ladder)
    assert ladder[0].name in done.stdout
    assert (tmp_path / "plot.svg").read_text().count("<svg") == 1
    assert sorted(path.name for path in folder.iterdir()) == ["cloud.ply", "ladder.json"]
