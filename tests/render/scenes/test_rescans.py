"""The registry follows the models directory, and keeps loaded scenes."""

from __future__ import annotations

import asyncio
import errno
import hashlib
import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

import pytest

from reference.ply import write_ply
from tests.render.scenes import plys
from tests.render.scenes.registry_bench import Bench, states
from tests.render.scenes.start_view.captures import statue, turned
from tigas_common.errors import BrokenScene, Overloaded, UnknownScene
from tigas_common.wire.render import StartCamera
from tigas_render.scenes import directory as directory_module
from tigas_render.scenes import registry as registry_module
from tigas_render.scenes import scene_file
from tigas_render.scenes.directory import scan_directory
from tigas_render.scenes.source import SceneMetadata, SceneSource
from tigas_render.scenes.start_view.view import StartViewCache

pytestmark = pytest.mark.anyio


def make_scene(folder: Path, count: int = 5, **metadata: Any) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    write_ply(folder / "scene.ply", plys.gaussians(count))
    if metadata:
        (folder / "scene.json").write_text(SceneMetadata(**metadata).model_dump_json())
    return folder


async def test_a_directory_of_scenes(tmp_path: Path) -> None:
    make_scene(tmp_path / "garden", name="The garden", background=(0.1, 0.2, 0.3))
    make_scene(tmp_path / "Küche 2")
    plys.write(tmp_path / "torn" / "scene.ply", plys.binary_ply()[:-1])
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    assert states(registry) == {"Küche 2": "unloaded", "garden": "unloaded", "torn": "broken"}
    garden = registry.scene_info("garden")
    assert (garden.name, garden.gaussians, garden.sh_degree) == ("The garden", 5, 0)
    assert garden.background == (0.1, 0.2, 0.3)
    assert garden.file_bytes == (tmp_path / "garden" / "scene.ply").stat().st_size
    assert registry.scene_info("Küche 2").preview == "/scenes/K%C3%BCche%202/preview"
    assert "truncated" in (registry.scene_info("torn").error or "")
    async with registry.use("garden") as scene:
        assert scene.background == (0.1, 0.2, 0.3)
    with pytest.raises(BrokenScene, match="truncated"):
        await registry.load("torn")


async def test_a_rescan_follows_the_directory_and_keeps_what_is_loaded(tmp_path: Path) -> None:
    for name in ("stays", "goes", "changes"):
        make_scene(tmp_path / name)
    plys.write(tmp_path / "torn" / "scene.ply", b"")
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    for name in ("stays", "goes", "changes"):
        await registry.load(name)
    async with registry.use("stays") as scene:
        before = scene.prepared
    shutil.rmtree(tmp_path / "goes")
    make_scene(tmp_path / "changes", count=7)
    make_scene(tmp_path / "torn")
    make_scene(tmp_path / "stays" / "ignored")
    (tmp_path / "stays" / "scene.json").write_text(
        '{"name": "Renamed", "camera": {"position": [1,2,3], "look_at": [0,0,0]}}'
    )
    await registry.scan()
    assert states(registry) == {"changes": "unloaded", "stays": "loaded", "torn": "unloaded"}
    assert registry.scene_info("changes").gaussians == 7
    assert registry.scene_info("stays").name == "Renamed"
    async with registry.use("stays") as scene:
        assert scene.prepared is before
        assert scene.camera == StartCamera(position=(1, 2, 3), look_at=(0, 0, 0))


async def test_a_derived_view_is_known_after_a_restart_without_loading(tmp_path: Path) -> None:
    folder = make_scene(tmp_path / "models" / "lying")
    scene, up = turned(statue(), (1, 0, 0), -90)
    write_ply(folder / "scene.ply", scene)
    files = sorted(folder.iterdir())
    views = StartViewCache(tmp_path / "cache")
    registry = Bench(budget=10**8).registry(tmp_path / "models", views=views)
    await registry.scan()
    before = registry.scene_info("lying")
    assert (before.up, before.camera) == ((0, -1, 0), None)
    await registry.load("lying")
    info = registry.scene_info("lying")
    assert info.up == pytest.approx(up, abs=0.05)
    assert info.camera is not None
    registry.unload("lying")
    restarted = Bench(budget=10**6).registry(tmp_path / "models", views=views)
    await restarted.scan()
    known = restarted.scene_info("lying")
    assert (known.state, known.up, known.camera) == ("unloaded", info.up, info.camera)
    assert sorted(folder.iterdir()) == files, "the scene's folder is the user's"


async def test_scene_json_takes_the_place_of_a_derived_view(tmp_path: Path) -> None:
    folder = make_scene(tmp_path / "models" / "garden")
    registry = Bench(budget=10**6).registry(tmp_path / "models", views=StartViewCache(tmp_path / "cache"))
    await registry.scan()
    await registry.load("garden")
    derived = registry.scene_info("garden").camera
    (folder / "scene.json").write_text('{"up": [0, 0, 1]}')
    await registry.scan()
    assert registry.scene_info("garden").up == (0, 0, 1)
    (folder / "scene.json").write_text('{"camera": {"position": [1, 2, 3], "look_at": [0, 0, 0]}}')
    await registry.scan()
    info = registry.scene_info("garden")
    assert (info.up, info.camera) == ((0, -1, 0), StartCamera(position=(1, 2, 3), look_at=(0, 0, 0)))
    (folder / "scene.json").unlink()
    await registry.scan()
    assert registry.scene_info("garden").camera == derived


async def test_metadata_that_is_edited_while_a_scene_loads_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_scene(tmp_path / "garden")
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    loading, edited = threading.Event(), threading.Event()

    def digest(_: object) -> str:
        loading.set()
        assert edited.wait(10)
        return "00" * 32

    monkeypatch.setattr(directory_module, "_sha256", digest)
    loaded = asyncio.create_task(registry.load("garden"))
    assert await asyncio.to_thread(loading.wait, 10)
    (folder / "scene.json").write_text('{"camera": {"position": [1, 2, 3], "look_at": [0, 0, 0]}}')
    await registry.scan()
    edited.set()
    await loaded
    assert registry.scene_info("garden").camera == StartCamera(position=(1, 2, 3), look_at=(0, 0, 0))
    async with registry.use("garden") as scene:
        assert scene.camera == registry.scene_info("garden").camera


async def test_scenes_stay_while_their_directory_cannot_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    make_scene(tmp_path / "garden")
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    await registry.load("garden")

    def broken(_: Path) -> Iterator[Path]:
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "iterdir", broken)
        await registry.scan()
    assert "Too many open files" in caplog.text
    assert states(registry) == {"garden": "loaded"}
    async with registry.use("garden"):
        pass


def break_reading(monkeypatch: pytest.MonkeyPatch, module: ModuleType, function: str) -> None:
    def broken(path: Path) -> NoReturn:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(module, function, broken)


@pytest.mark.parametrize(
    ("module", "function"),
    [(scene_file, "open_regular"), (directory_module, "find_scene_file"), (directory_module, "_version")],
)
async def test_a_loaded_scene_stays_while_its_file_cannot_be_read(
    module: ModuleType,
    function: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    for name in ("garden", "unloaded"):
        make_scene(tmp_path / name)
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    await registry.load("garden")
    with monkeypatch.context() as patched:
        break_reading(patched, module, function)
        await registry.scan()
    assert states(registry) == {"garden": "loaded", "unloaded": "broken"}
    assert "garden stays loaded, unchanged: " in caplog.text
    await registry.scan()
    assert states(registry) == {"garden": "loaded", "unloaded": "unloaded"}


async def test_a_loaded_single_file_stays_while_it_cannot_be_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "garden.ply"
    write_ply(file, plys.gaussians(5))
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    await registry.load("garden")
    stat = Path.stat

    def broken(path: Path, **options: bool) -> os.stat_result:
        if path == file:
            raise PermissionError(errno.EACCES, "Permission denied")
        return stat(path, **options)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "stat", broken)
        await registry.scan()
    assert states(registry) == {"garden": "loaded"}


async def test_a_loaded_scene_does_not_stay_if_its_file_was_changed_or_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("changed", "removed"):
        make_scene(tmp_path / name)
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    for name in ("changed", "removed"):
        await registry.load(name)
    make_scene(tmp_path / "changed", count=7)
    (tmp_path / "removed" / "scene.ply").unlink()
    break_reading(monkeypatch, scene_file, "open_regular")
    await registry.scan()
    assert states(registry) == {"changed": "broken", "removed": "broken"}


async def test_a_scene_has_the_digest_of_the_file_that_was_loaded(tmp_path: Path) -> None:
    file = make_scene(tmp_path / "garden") / "scene.ply"
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    assert registry.scene_info("garden").file_sha256 is None, "nobody reads gigabytes to list scenes"
    await registry.load("garden")
    first = hashlib.sha256(file.read_bytes()).hexdigest()
    assert registry.scene_info("garden").file_sha256 == first
    registry.unload("garden")
    assert registry.scene_info("garden").file_sha256 == first
    changed = bytearray(file.read_bytes())
    changed[-1] ^= 1  # of the same size
    file.write_bytes(changed)
    os.utime(file, ns=(1, 1))
    for rescanned in (False, True):
        if rescanned:
            await registry.scan()
        await registry.load("garden")
        assert registry.scene_info("garden").file_sha256 == hashlib.sha256(changed).hexdigest()


async def test_a_scene_that_vanishes_stays_with_whoever_uses_it_and_counts_until_then(tmp_path: Path) -> None:
    make_scene(tmp_path / "goes", count=80)
    bench = Bench(budget=5000)
    bench.add("other", count=4950)
    registry = bench.registry(tmp_path)
    await registry.scan()
    async with registry.use("goes") as scene:
        shutil.rmtree(tmp_path / "goes")
        await registry.scan()
        assert scene.prepared.nbytes == 80
        with pytest.raises(UnknownScene):
            registry.scene_info("goes")
        with pytest.raises(Overloaded):
            await registry.load("other")
    await registry.load("other")


async def test_loading_a_broken_scene_looks_at_its_file_again(tmp_path: Path) -> None:
    plys.write(tmp_path / "torn" / "scene.ply", b"")
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    with pytest.raises(BrokenScene, match="empty"):
        await registry.load("torn")
    make_scene(tmp_path / "torn")
    await registry.load("torn")
    assert registry.scene_info("torn").state == "loaded"


class SlowDisk:
    """Lists a directory at once, and answers when it is let."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.listed = threading.Semaphore(0)
        self.answers = threading.Semaphore(0)
        self.listings = 0
        monkeypatch.setattr(registry_module, "scan_directory", self.scan)

    def scan(self, directory: Path) -> dict[str, SceneSource]:
        found = scan_directory(directory)
        self.listings += 1
        self.listed.release()
        assert self.answers.acquire(timeout=10)
        return found


async def test_a_listing_from_before_a_change_undoes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = SlowDisk(monkeypatch)
    make_scene(tmp_path / "removed")
    scenes = Bench(budget=10**6).registry(tmp_path)
    early = asyncio.create_task(scenes.scan())
    assert await asyncio.to_thread(disk.listed.acquire, timeout=10)
    make_scene(tmp_path / "new")
    shutil.rmtree(tmp_path / "removed")
    late = [asyncio.create_task(scenes.scan()) for _ in range(3)]
    disk.answers.release(10)
    await asyncio.gather(early, *late)
    assert states(scenes) == {"new": "unloaded"}
    assert disk.listings == 2, "those that waited shared one"


async def test_a_scan_that_is_given_up_holds_up_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = SlowDisk(monkeypatch)
    scenes = Bench(budget=10**6).registry(tmp_path)
    early = asyncio.create_task(scenes.scan())
    assert await asyncio.to_thread(disk.listed.acquire, timeout=10)
    make_scene(tmp_path / "new")
    late = asyncio.create_task(scenes.scan())
    early.cancel()
    disk.answers.release(10)
    await late
    assert states(scenes) == {"new": "unloaded"}


async def test_a_folder_takes_the_place_of_a_built_in_scene(tmp_path: Path) -> None:
    bench = Bench.of("a", "b", "c")
    make_scene(tmp_path / "a", count=3)
    registry = bench.registry(tmp_path)
    assert registry.scene_info("a").gaussians is None
    await registry.scan()
    assert registry.scene_info("a").gaussians == 3
    assert set(states(registry)) == {"a", "b", "c"}
