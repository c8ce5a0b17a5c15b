"""Which file of a folder is the scene, and which folders are scenes."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import pytest

from tests.not_files import NOT_FILES
from tests.render.scenes import made_up, plys
from tigas_common.errors import BrokenScene
from tigas_render.scenes import directory
from tigas_render.scenes.directory import find_scene_file, read_scene_file, read_source, scan_directory
from tigas_render.scenes.scene_file import SceneFile


def test_of_several_files_the_first_counts_and_the_log_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for name in ("b.ply", "A.PLY", "notes.txt"):
        plys.write(tmp_path / name, plys.binary_ply())
    with caplog.at_level(logging.WARNING):
        assert find_scene_file(tmp_path).name == "A.PLY"
    assert "2 files that may be the scene; A.PLY is used" in caplog.text


def test_the_last_iteration_of_a_training_goes_before_its_input(tmp_path: Path) -> None:
    plys.write(tmp_path / "input.ply", b"a point cloud")
    for iteration in ("iteration_7000", "iteration_30000", "iteration_900", "iteration_best", "iteration_99999"):
        (tmp_path / "point_cloud" / iteration).mkdir(parents=True)
        if iteration != "iteration_99999":
            plys.write(tmp_path / "point_cloud" / iteration / "point_cloud.ply", plys.binary_ply())
    assert find_scene_file(tmp_path) == tmp_path / "point_cloud" / "iteration_30000" / "point_cloud.ply"
    assert read_source(tmp_path).error is None


def test_a_folder_without_a_scene_says_so(tmp_path: Path) -> None:
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(BrokenScene, match=r"has no scene: no \.ply, \.sog, \.spz, \.splat, no lod-meta\.json"):
        find_scene_file(tmp_path)


@pytest.mark.parametrize("kind", NOT_FILES)
def test_what_is_no_file_makes_its_scene_broken_and_no_other(tmp_path: Path, kind: str) -> None:
    for name in ("good", "description", "preview", "ladder"):
        plys.write(tmp_path / name / "scene.ply", plys.binary_ply())
    (tmp_path / "scene").mkdir()
    NOT_FILES[kind](tmp_path / "scene" / "scene.ply")
    NOT_FILES[kind](tmp_path / "description" / "scene.json")
    NOT_FILES[kind](tmp_path / "preview" / "preview.jpg")
    NOT_FILES[kind](tmp_path / "ladder" / "ladder.json")
    sources = scan_directory(tmp_path)
    assert sources["ladder"].ladder is None
    errors = {id: source.error for id, source in sources.items()}
    assert str(errors.pop("scene")).startswith("The folder scene has no scene:")
    assert str(errors.pop("description")).startswith("scene.json cannot be read: ")
    assert errors == {"good": None, "preview": None, "ladder": None}


@pytest.mark.parametrize("kind", NOT_FILES)
def test_a_scene_that_became_no_file_is_broken(tmp_path: Path, kind: str) -> None:
    NOT_FILES[kind](tmp_path / "scene.ply")
    with pytest.raises(BrokenScene, match=r"scene.ply (cannot be read: .+|has no scene:.+)\."):
        read_scene_file(tmp_path / "scene.ply").load()


def test_hidden_names_are_skipped_and_unsafe_ones_with_a_word(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    names = ("good", "new\nline", "per%cent", "back\\slash", "ask?", "x" * 129, " space")
    for name in (*names, os.fsdecode(b"\xff")):
        plys.write(tmp_path / name / "scene.ply", plys.binary_ply())
    plys.write(tmp_path / "file.txt", plys.binary_ply())
    plys.write(tmp_path / ".hidden" / "scene.ply", plys.binary_ply())
    with caplog.at_level(logging.WARNING):
        assert list(scan_directory(tmp_path)) == ["good"]
    assert len(caplog.records) == len(names)
    assert all("Skipped" in record.getMessage() for record in caplog.records)


def test_links_are_followed_also_out_of_the_directory(tmp_path: Path) -> None:
    plys.write(tmp_path / "elsewhere" / "scene.ply", plys.binary_ply())
    models = tmp_path / "models"
    models.mkdir()
    (models / "linked").symlink_to(tmp_path / "elsewhere")
    (models / "loop").symlink_to(models / "loop")
    sources = scan_directory(models)
    assert list(sources) == ["linked"]
    assert sources["linked"].gaussians == 3


@pytest.mark.parametrize("line", [b"element vertex 0_0", b"element vertex +0", b"element\x0bvertex 0"])
def test_a_hostile_header_breaks_its_own_scene_only(tmp_path: Path, line: bytes) -> None:
    plys.write(tmp_path / "bad" / "scene.ply", plys.binary_ply().replace(b"element vertex 3", line))
    plys.write(tmp_path / "good" / "scene.ply", plys.binary_ply())
    sources = scan_directory(tmp_path)
    assert "broken PLY header" in (sources["bad"].error or "")
    assert sources["good"].error is None


@pytest.mark.parametrize("error", [MemoryError(), KeyError("vertex"), RecursionError()])
def test_whatever_a_scene_provokes_breaks_no_other(
    tmp_path: Path, error: Exception, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def read(path: Path) -> SceneFile:
        if path.parent.name == "bad":
            raise error
        return read_scene_file(path)

    monkeypatch.setattr(directory, "read_scene_file", read)
    for name in ("bad", "good"):
        plys.write(tmp_path / name / "scene.ply", plys.binary_ply())
    sources = scan_directory(tmp_path)
    assert sources["bad"].error == "bad could not be read; the server's log says why."
    assert sources["bad"].open is None
    assert sources["good"].error is None
    assert type(error).__name__ in caplog.text


def test_a_link_that_cannot_be_followed_is_one_broken_scene(tmp_path: Path) -> None:
    plys.write(tmp_path / "good" / "scene.ply", plys.binary_ply())
    (tmp_path / "bad").symlink_to("x" * 300)
    sources = scan_directory(tmp_path)
    assert sources["bad"].error == "bad cannot be read: File name too long."
    assert sources["good"].error is None


def test_a_directory_that_is_not_there_has_no_scenes(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert scan_directory(tmp_path / "nowhere") == {}
    assert "There is no models directory" in caplog.text


def test_a_preview_and_a_version_come_with_the_source(tmp_path: Path) -> None:
    plys.write(tmp_path / "scene.ply", plys.binary_ply())
    first = read_source(tmp_path)
    assert first.preview is None
    plys.write(tmp_path / "preview.png", b"")
    plys.write(tmp_path / "scene.ply", plys.binary_ply(4))
    second = read_source(tmp_path)
    assert second.preview == tmp_path / "preview.png"
    assert second.version != first.version


def test_a_file_by_itself_is_a_scene_by_its_name(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    names = ("garden.ply", "attic.compressed.ply", "cellar.SPZ", "garden.spz", "hall.ply", "new%20line.sog", "a.txt")
    for name in names:
        plys.write(tmp_path / name, plys.binary_ply())
    plys.write(tmp_path / "hall" / "scene.ply", plys.binary_ply(4))
    with caplog.at_level(logging.WARNING):
        sources = scan_directory(tmp_path)
    assert list(sources) == ["attic", "cellar", "garden", "hall"], "by name"
    assert {source.error for source in sources.values()} == {None}
    assert sources["hall"].gaussians == 4, "a folder goes before a file"
    assert "garden.ply" in sources["garden"].version, "and a PLY before what is packed"
    assert [record.getMessage() for record in caplog.records] == [
        "Skipped the file hall.ply: there is another scene hall",
        "Skipped the file 'new%20line.sog': its name has characters that an id may not have",
        "Skipped the file garden.spz: there is another scene garden",
    ]
    assert len(sources["garden"].load()) == 3


def test_a_folder_of_images_is_a_scene_whose_images_count(tmp_path: Path) -> None:
    folder = made_up.unzip(tmp_path / "shell")
    source = read_source(folder)
    assert (source.error, source.format, source.gaussians, source.sh_degree) == (None, "SOG folder", made_up.COUNT, 1)
    assert_part_of(folder, folder / "sh0.webp")


def assert_part_of(folder: Path, image: Path) -> None:
    """All of a folder's files count as the scene's, and a change of this one is a change of the scene."""
    first = read_source(folder)
    assert first.file_bytes == sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    assert first.digest is not None
    digest = first.digest()
    os.utime(image, (1, 1))
    image.write_bytes(image.read_bytes() + b"\0")
    second = read_source(folder)
    assert second.version != first.version
    assert second.digest is not None
    assert second.digest() != digest
