"""`tigas scene ladder`: from a scene's folder to a ladder.json that the service takes."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from reference.ply import write_ply
from tests.command import Result, tigas
from tests.render.ladder.test_measure import cloud
from tests.render.scenes import plys
from tigas_common.errors import StartError
from tigas_render.ladder.make import find_scene, make, place_of
from tigas_render.scenes.directory import read_source


def test_a_folder_goes_before_a_built_in_scene_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_scene("courtyard").folder is None
    plys.write(tmp_path / "courtyard" / "scene.ply", plys.binary_ply())
    source = find_scene("courtyard")
    assert source.folder == tmp_path / "courtyard"
    assert place_of(source) == tmp_path / "courtyard" / "ladder.json"


def test_what_is_no_scene_gets_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(StartError, match=r"'nowhere' is neither .* \(courtyard\)"):
        find_scene("nowhere")
    with pytest.raises(StartError, match=r"no \.ply"):
        find_scene(str(tmp_path))
    with pytest.raises(StartError, match="--out"):
        place_of(find_scene("courtyard"))


@pytest.mark.slow
def test_the_command_writes_a_ladder_that_the_service_takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "cloud"
    folder.mkdir()
    write_ply(folder / "cloud.ply", cloud())
    (folder / "ladder.json").write_text("broken")

    monkeypatch.setattr("tigas_render.ladder.make.make", partial(make, rungs=8, views=1))

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
