"""Streamed SOG: the finest level of each part is drawn, and any fault in its files is one sentence."""

from __future__ import annotations

import json
import os
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.fuzz.fuzzers import assert_sentence
from tests.render.raster.views import psnr
from tests.render.scenes import made_up, plys
from tests.render.scenes.test_directory import assert_part_of
from tests.render.scenes.test_formats import picture, shell_picture
from tigas_common.errors import BrokenScene
from tigas_render.downloads.cache import write_download
from tigas_render.gaussians import Gaussians
from tigas_render.scenes.directory import find_scene_file, read_scene_file, read_source, scan_directory
from tigas_render.scenes.library_operations import add_scene

NAMES = ("0_0/meta.json", "0_1/meta.json", "1_0/meta.json")
"""Two files of the finest level, and one of the next."""
SHELL = made_up.FILES / "shell.sog"


def leaf(**levels: tuple[float, float, float]) -> dict[str, Any]:
    """Of a tree: file, offset and count by level (`l0`, `l1`)."""
    runs = {name[1:]: dict(zip(("file", "offset", "count"), run, strict=True)) for name, run in levels.items()}
    return {"bound": {"min": [-1, -1, -1], "max": [1, 1, 1]}, "lods": runs}


def node(*children: dict[str, Any]) -> dict[str, Any]:
    return {"bound": {"min": [-1, -1, -1], "max": [1, 1, 1]}, "children": list(children)}


TREE = node(
    node(leaf(l0=(1, 0, 200), l1=(2, 0, 50)), leaf(l1=(2, 50, 20))),
    node(leaf(l1=(2, 70, 5), l0=(0, 0, 300)), leaf(l0=(1, 200, 100))),
)
"""Of both files of the finest level all Gaussians, and 20 of the next where there are no finer ones."""
META = {
    "version": 1,
    "asset": {"generator": "by hand"},
    "count": 675,
    "counts": [600, 75],
    "lodLevels": 2,
    "filenames": list(NAMES),
    "tree": TREE,
}


def write(folder: Path, meta: dict[str, Any] | bytes = META, names: tuple[str, ...] = NAMES) -> Path:
    """The made-up scene's SOG under each of the names, and a lod-meta.json; its path."""
    for name in names:
        made_up.unzip((folder / name).parent)
    return plys.write(folder / "lod-meta.json", meta if isinstance(meta, bytes) else json.dumps(meta).encode())


def changed(**changes: Any) -> dict[str, Any]:
    return {**META, **changes}


def test_what_splat_transform_makes_shows_the_scene(tmp_path: Path) -> None:
    file = read_scene_file(made_up.unzip(tmp_path, "shell.streamed.zip"))
    assert (file.format, file.count, file.sh_degree) == ("streamed SOG", made_up.COUNT + 2, 1)
    loaded = file.load()
    near = Gaussians(*(array[: made_up.COUNT] for array in loaded.arrays))
    assert psnr(picture(near), shell_picture(1)) > 40
    assert np.abs(loaded.means[made_up.COUNT :, 2]) == pytest.approx(50, rel=1e-3), "the environment"


def test_of_each_place_the_finest_level_is_read_file_by_file(tmp_path: Path) -> None:
    file = read_scene_file(write(tmp_path))
    assert (file.count, len(file.files)) == (620, 1 + 3 * 8)
    shell = read_scene_file(SHELL).load()
    places = [*range(300), *range(50, 70), *range(300)]  # in the order in which the tree names the files
    for got, expected in zip(file.load().arrays, shell.arrays, strict=True):
        assert np.array_equal(got, expected[places])


def test_the_coarse_part_is_the_coarsest_level_of_each_place(tmp_path: Path) -> None:
    tree = node(leaf(l0=(1, 0, 300), l1=(2, 0, 100)), leaf(l0=(0, 0, 300), l1=(2, 0, 100), l2=(2, 100, 51)))
    assert read_scene_file(write(tmp_path, changed(tree=tree))).coarse() is None, "it saves less than three quarters"
    tree = node(leaf(l0=(1, 0, 300), l2=(2, 0, 3)), leaf(l0=(0, 0, 300), l1=(2, 200, 50), l2=(2, 3, 4)))
    coarse = read_scene_file(write(tmp_path, changed(tree=tree))).coarse()
    assert coarse is not None
    assert (coarse.count, coarse.sh_degree) == (7, 1)
    assert np.array_equal(coarse.load().means, read_scene_file(SHELL).load().means[:7])


def test_progress_is_that_of_all_files(tmp_path: Path) -> None:
    heard: list[float] = []
    assert sum(map(len, read_scene_file(write(tmp_path)).open(heard.append).parts)) == 620
    assert heard == sorted(heard)
    assert len(heard) > 6
    assert heard[-1] == 1


def test_files_that_no_finest_level_needs_may_be_missing(tmp_path: Path) -> None:
    tree = node(leaf(l0=(0, 0, 300), l1=(2, 0, 75)), leaf(l0=(1, 100, 0), l5=(1, 0, 10)))
    file = read_scene_file(write(tmp_path, changed(tree=tree), NAMES[:2]))
    assert file.count == 310


def test_an_environment_of_a_lower_degree_is_drawn_too_and_a_file_may_be_one_zip(tmp_path: Path) -> None:
    path = write(tmp_path, changed(environment="env/sky.sog"))
    with zipfile.ZipFile(SHELL) as bundle:
        meta = {name: part for name, part in json.loads(bundle.read("meta.json")).items() if name != "shN"}
        (tmp_path / "env").mkdir()
        with zipfile.ZipFile(tmp_path / "env" / "sky.sog", "w") as sky:
            sky.writestr("meta.json", json.dumps(meta))
            for name in bundle.namelist():
                if name != "meta.json":
                    sky.writestr(name, bundle.read(name))
    loaded, shell = read_scene_file(path).load(), read_scene_file(SHELL).load()
    assert (len(loaded), loaded.sh_degree) == (920, 1)
    assert np.array_equal(loaded.sh[620:, 0], shell.sh[:, 0])
    assert not loaded.sh[620:, 1:].any()


def write_environment(folder: Path, name: str) -> None:
    """The made-up scene's SOG again: as a file, or else as a folder."""
    if name.endswith(".sog"):
        plys.write(folder / name, SHELL.read_bytes())
    else:
        made_up.unzip(folder / name)


@pytest.mark.parametrize(
    ("entry", "name"),
    [
        ("sky.sog", "sky.sog"),
        ("sky/meta.json", "sky"),
        ("sky", "sky"),
        ("sky/", "sky"),
        (None, "environment.sog"),
        (None, "environment"),
    ],
)
def test_an_environment_is_part_of_the_scene_whether_it_is_named_or_not(
    tmp_path: Path, entry: str | None, name: str
) -> None:
    garden = tmp_path / "garden"
    write(garden, changed(environment=entry))
    write_environment(garden, name)
    source = read_source(garden)
    assert (source.error, source.format, source.gaussians) == (None, "streamed SOG", 920)
    assert np.array_equal(source.load().means[620:], read_scene_file(SHELL).load().means)
    assert_part_of(garden, garden / name if name.endswith(".sog") else garden / name / "sh0.webp")


@pytest.mark.parametrize("name", ["environment.sog", "scene.ply", "point_cloud/iteration_7/point_cloud.ply"])
def test_no_other_file_is_taken_for_a_streamed_scene(tmp_path: Path, name: str) -> None:
    write(tmp_path)
    write_environment(tmp_path, "environment.sog")
    plys.write(tmp_path / name, SHELL.read_bytes())
    assert find_scene_file(tmp_path) == tmp_path / "lod-meta.json"
    plys.write(tmp_path / "lod-meta.json", b"{")
    assert "is not one of streamed SOG" in str(read_source(tmp_path).error)
    (tmp_path / "lod-meta.json").unlink()
    (tmp_path / "lod-meta.json").symlink_to("nowhere")
    assert "cannot be read" in str(read_source(tmp_path).error)


def test_files_from_before_there_were_versions_are_read(tmp_path: Path) -> None:
    old = {name: META[name] for name in ("lodLevels", "filenames", "tree")} | {"environment": None}
    assert read_scene_file(write(tmp_path, old)).count == 620


def test_a_folder_with_a_lod_meta_is_a_scene_whose_files_count(tmp_path: Path) -> None:
    write(tmp_path)
    source = read_source(tmp_path)
    assert (source.error, source.format, source.gaussians, source.sh_degree) == (None, "streamed SOG", 620, 1)
    assert_part_of(tmp_path, tmp_path / "0_1" / "sh0.webp")


@pytest.mark.parametrize("named", ["hall", "hall/lod-meta.json"])
def test_an_added_one_stays_a_folder_with_all_levels(tmp_path: Path, named: str) -> None:
    meta = changed(tree=leaf(l0=(0, 0, 300), l1=(2, 0, 75), l2=(3, 0, 10)), filenames=[*NAMES, "missing.sog"])
    write(tmp_path / "hall", meta)
    write_environment(tmp_path / "hall", "environment")
    (tmp_path / "hall" / "notes.txt").write_text("no part of the scene")
    models = tmp_path / "models"
    id, file = add_scene(str(tmp_path / named), models, None, lambda _: None, 1_000_000)
    assert (id, file.count) == ("hall", 600)
    assert [path.name for path in models.iterdir()] == ["hall"]
    folders = ["0_0", "0_1", "1_0", "environment"]
    assert sorted(path.name for path in (models / "hall").iterdir()) == [*folders, "lod-meta.json"]
    assert all((models / "hall" / folder / "quats.webp").is_file() for folder in folders)
    assert len(scan_directory(models)["hall"].load()) == 600


@pytest.mark.parametrize("environment", ["environment.sog", "environment"])
def test_one_can_be_added_and_downloaded_with_its_environment(tmp_path: Path, environment: str) -> None:
    write(tmp_path / "hall")
    write_environment(tmp_path / "hall", environment)
    _, file = add_scene(str(tmp_path / "hall"), tmp_path / "models", None, lambda _: None, 10**9)
    assert file.count == 920
    made = write_download(scan_directory(tmp_path / "models")["hall"], tmp_path / "hall.ply", lambda: None)
    assert (made.gaussians, len(read_scene_file(tmp_path / "hall.ply").load())) == (920, 920)


def test_one_that_cannot_be_added_leaves_nothing(tmp_path: Path) -> None:
    write(tmp_path / "hall")
    (tmp_path / "hall" / "0_1" / "quats.webp").write_bytes(b"GIF89a" + bytes(100))
    with pytest.raises(BrokenScene, match=r"^0_1/meta\.json: quats\.webp is not a lossless WebP image\.$"):
        add_scene(str(tmp_path / "hall"), tmp_path / "models", None, lambda _: None, 1_000_000)
    assert list((tmp_path / "models").iterdir()) == []


DEEP = b'{"filenames":["0_0/meta.json"],"tree":' + b'{"children":[' * 5000 + b"]}" * 5001


INDICES: dict[str, tuple[dict[str, Any] | bytes, str]] = {
    "nothing but brackets": (b"[" * 10_000, "is not one of streamed SOG, version 1: "),
    "cut off": (json.dumps(META).encode()[:-9], "is not one of streamed SOG, version 1: "),
    "of 17 MiB": (changed(x="x" * (17 << 20)), "is larger than 16777216 bytes"),
    "of a version to come": (changed(version=2), "version: input should be 1"),
    "without a tree": ({name: META[name] for name in META if name != "tree"}, "tree: field required"),
    "with a tree of another type": (changed(tree=[TREE]), "tree: input should be an object"),
    "with an empty tree": (changed(tree={}), "has 0 Gaussians"),
    "with empty leaves": (changed(tree=node(leaf(), leaf(l0=(0, 0, 0)))), "has 0 Gaussians"),
    "with a deep tree": (DEEP, "is not one of streamed SOG, version 1: "),
    "with 200,000 wrong leaves": (changed(tree=node(*[{"lods": 1}] * 200_000)), "lods: input should be"),
    "with NaN": (changed(tree=leaf(l0=(0, float("nan"), 1))), "offset: "),
    "with half a Gaussian": (changed(tree=leaf(l0=(0, 0, 1.5))), "count: "),
    "with less than none": (changed(tree=leaf(l0=(0, 0, -1))), "count: input should be greater than or equal to 0"),
    "with an offset below 0": (changed(tree=leaf(l0=(0, -5, 10))), "offset: input should be greater than"),
    "with 2⁶³ Gaussians": (changed(tree=leaf(l0=(0, 0, 2**63))), "count: input should be less than or equal"),
    "with a level below 0": (changed(tree={"lods": {"-1": {"file": 0, "offset": 0, "count": 1}}}), "greater than"),
    "with a level that is none": (changed(tree={"lods": {"best": {"file": 0, "offset": 0, "count": 1}}}), "integer"),
    "beyond a file's end": (changed(tree=leaf(l0=(0, 299, 2))), "takes 301 Gaussians or more of 0_0/meta.json"),
    "with a file that has no name": (changed(tree=leaf(l0=(3, 0, 1))), "takes Gaussians from file 3, and names 3"),
    "with a file before the first": (changed(tree=leaf(l0=(-1, 0, 1))), "takes Gaussians from file -1"),
    "with overlapping runs": (changed(tree=node(leaf(l0=(0, 0, 20)), leaf(l0=(0, 19, 5)))), "of 0_0/meta.json twice"),
    "with a file under two names": (
        changed(filenames=[NAMES[0]] * 3, tree=node(leaf(l0=(0, 0, 20)), leaf(l0=(1, 0, 20)))),
        "of 0_0/meta.json twice",
    ),
    "with 5,000 files": (changed(filenames=[NAMES[0]] * 5000), "filenames: tuple should have at most 4096"),
    "without a file": (
        changed(filenames=["0_9/meta.json"], tree=leaf(l0=(0, 0, 1))),
        r"^0_9/meta\.json: meta\.json cannot be read: No such",
    ),
    "without an environment": (changed(environment="env/meta.json"), "^env/meta.json: meta.json cannot be read: No s"),
    **{
        f"with the file {name[:20]}": (
            changed(filenames=[name, *NAMES[1:]]),
            "not a plain name|at most 200|cannot be read",
        )
        for name in (
            *("/etc/passwd", "../0_0/meta.json", "0_0/../../x/meta.json", "0_0\\meta.json", "", ".", "0_0/", "//x"),
            *("http://example.org/meta.json", "C:/meta.json", "a\0b", "0_0/.hidden", "~/meta.json", "x" * 201),
        )
    },
    "with an environment elsewhere": (changed(environment="../env/meta.json"), "environment: '../env/meta.json' is no"),
}


@pytest.mark.parametrize(("meta", "words"), INDICES.values(), ids=INDICES)
def test_a_hostile_index_is_refused_in_a_sentence(tmp_path: Path, meta: dict[str, Any] | bytes, words: str) -> None:
    path = write(tmp_path, meta)
    tracemalloc.start()
    with pytest.raises(BrokenScene, match=words) as failure:
        read_scene_file(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3_000_000 + 3 * path.stat().st_size
    assert_sentence(failure.value.detail)


def link_to_itself(part: Path) -> None:
    (part / "meta.json").unlink()
    (part / "meta.json").symlink_to("meta.json")


def make_a_pipe(part: Path) -> None:
    (part / "meta.json").unlink()
    os.mkfifo(part / "meta.json")


def promise_much(part: Path) -> None:
    meta = part / "meta.json"
    meta.write_text(meta.read_text().replace('"count":300', '"count":30000000'))


PARTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "that is no SOG": (lambda part: (part / "meta.json").write_text("{}"), "meta.json has a meta.json that is not one"),
    "without an image": (lambda part: (part / "sh0.webp").unlink(), ".*cannot be read: No such file"),
    "that is a loop of links": (link_to_itself, "meta.json cannot be read: Too many levels"),
    "that is a pipe": (make_a_pipe, "meta.json cannot be read: Not a regular file"),
    "with a promise": (promise_much, "meta.json promises 30000000 Gaussians in"),
}


@pytest.mark.parametrize(("spoil", "words"), PARTS.values(), ids=PARTS)
def test_a_broken_file_is_named(tmp_path: Path, spoil: Callable[[Path], object], words: str) -> None:
    path = write(tmp_path / "scene")
    spoil(tmp_path / "scene" / "0_1")
    with pytest.raises(BrokenScene, match=rf"^0_1/meta\.json: {words}"):
        read_scene_file(path)
    plys.write(tmp_path / "sound" / "scene.ply", plys.binary_ply())
    errors = {id: source.error is None for id, source in scan_directory(tmp_path).items()}
    assert errors == {"scene": False, "sound": True}


def test_a_file_that_changes_while_it_is_read_is_broken(tmp_path: Path) -> None:
    path = write(tmp_path)
    file = read_scene_file(path)
    meta = tmp_path / "0_1" / "meta.json"
    meta.write_text(meta.read_text().replace('"count":300', '"count":200'))
    with pytest.raises(BrokenScene, match=r"^0_1/meta\.json: meta\.json changed while it was being read"):
        file.load()


def test_only_what_is_read_of_one_file_at_a_time_is_in_memory(tmp_path: Path) -> None:
    names = tuple(f"0_{number}/meta.json" for number in range(24))
    tree = node(*(leaf(l0=(number, 0, 300)) for number in range(24)))

    def peak(count: int) -> int:
        path = write(tmp_path / str(count), changed(filenames=names, tree=node(*tree["children"][:count])), names)
        scene = read_scene_file(path).open(lambda _: None)
        tracemalloc.start()
        read = sum(map(len, scene.parts))
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert read == 300 * count
        return most

    peak(1)  # so that nothing is imported while memory is counted
    assert peak(24) < 1.5 * peak(1)
