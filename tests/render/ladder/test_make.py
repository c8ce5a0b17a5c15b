"""`tigas scene ladder`: from a scene's folder to a ladder.json that the service takes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.render.ladder.test_measure import cloud
from tests.render.scenes import plys
from tigas_common.errors import StartError
from tigas_render.ladder.make import find_scene, place_of
from tigas_render.scenes.directory import read_folder
from tigas_render.scenes.ply import write_ply

TIGAS = str(Path(sys.executable).parent / "tigas")


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


def test_the_command_writes_a_ladder_that_the_service_takes(tmp_path: Path) -> None:
    folder = tmp_path / "cloud"
    folder.mkdir()
    write_ply(folder / "cloud.ply", cloud())
    (folder / "ladder.json").write_text("broken")

    def run(*options: str) -> subprocess.CompletedProcess[str]:
        command = [TIGAS, "scene", "ladder", str(folder), "--views", "1", "--device", "cpu", *options]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)

    refused = run("--plot", str(tmp_path / "plot.gif"))
    assert refused.returncode == 1
    assert refused.stderr.splitlines()[-1] == f"{tmp_path}/plot.gif must end in .png or .svg."
    done = run("--plot", str(tmp_path / "plot.svg"), "--rungs", "8")
    assert done.returncode == 0, done.stderr
    ladder = read_folder(folder).ladder
    assert ladder is not None
    assert 2 <= len(ladder) <= 8
    assert all(rung.psnr_db is not None for rung in ladder)
    assert ladder[0].name in done.stdout
    assert (tmp_path / "plot.svg").read_text().count("<svg") == 1
    assert sorted(path.name for path in folder.iterdir()) == ["cloud.ply", "ladder.json"]
