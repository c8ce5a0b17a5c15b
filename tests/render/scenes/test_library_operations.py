"""An added file becomes a scene of the models directory; a refused one leaves no traces."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from fcntl import LOCK_EX, LOCK_NB
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from tests.eventually import wait_until
from tests.render.scenes import made_up, plys
from tigas_common.errors import BrokenScene
from tigas_common.processes import tigas_command
from tigas_common.wire.render import SceneEdit
from tigas_render.local_files import lock_directory
from tigas_render.scenes import directory as directory_module
from tigas_render.scenes import library_operations
from tigas_render.scenes.directory import scan_directory
from tigas_render.scenes.library_operations import (
    PART_PREFIX,
    SceneNotAdded,
    add_scene,
    display_name,
    edit_scene,
    remove_scene,
    rename_scene,
)

LIMIT = 1_000_000


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass

    def do_GET(self) -> None:
        if self.path == "/endless.ply":
            with suppress(OSError):
                self.wfile.write(b"HTTP/1.0 200 OK\r\n\r\nply\n")
                while True:
                    self.wfile.write(b"comment x\n" * 1000)
        elif self.path == "/trickle.ply":
            with suppress(OSError):
                self.wfile.write(b"HTTP/1.0 200 OK\r\nContent-Length: 500000\r\n\r\n")
                while True:
                    self.wfile.write(b"p")
                    time.sleep(0.01)
        else:
            super().do_GET()


@pytest.fixture
def site(tmp_path: Path) -> Iterator[str]:
    """A web site with the folder `site`."""
    (tmp_path / "site").mkdir()
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(tmp_path / "site"))) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.mark.parametrize(
    ("name", "stored"),
    [
        ("shell.sog", "shell.sog"),
        ("shell-3.spz", "shell-3.spz"),
        ("shell.compressed.ply", "shell.compressed.ply"),
    ],
)
def test_a_file_becomes_a_scene(tmp_path: Path, name: str, stored: str) -> None:
    models = tmp_path / "not" / "there" / "yet"
    id, file = add_scene(str(made_up.FILES / name), models, None, lambda _: None, LIMIT)
    assert file.files == (models / stored,)
    assert [path.name for path in models.iterdir()] == [stored]
    assert scan_directory(models)[id].gaussians == made_up.COUNT


def test_what_a_file_is_decides_its_ending_and_it_may_be_called_otherwise(tmp_path: Path) -> None:
    odd = plys.write(tmp_path / "download.bin", (made_up.FILES / "shell-4.spz").read_bytes())
    assert add_scene(str(odd), tmp_path / "models", "attic", lambda _: None, LIMIT)[0] == "attic"
    assert [path.name for path in (tmp_path / "models").iterdir()] == ["attic.spz"]


@pytest.mark.parametrize("named", ["hall", "hall/meta.json"])
def test_a_folder_of_images_becomes_one_file(tmp_path: Path, named: str) -> None:
    made_up.unzip(tmp_path / "hall")
    id, file = add_scene(str(tmp_path / named), tmp_path / "models", None, lambda _: None, LIMIT)
    assert (id, file.format, [path.name for path in file.files]) == ("hall", "SOG", ["hall.sog"])
    assert len(file.load()) == made_up.COUNT


def test_a_scene_is_fetched(tmp_path: Path, site: str) -> None:
    plys.write(tmp_path / "site" / "my shell.spz", (made_up.FILES / "shell-3.spz").read_bytes())
    heard: list[float] = []
    id, file = add_scene(f"{site}/my%20shell.spz?version=2", tmp_path / "models", None, heard.append, LIMIT)
    assert (id, file.count, heard[-1]) == ("my shell", made_up.COUNT, 1.0)


@pytest.mark.parametrize("name", ["Mu\u0308nchen", "हिन्दी", "தமிழ்"])
def test_a_name_has_the_letters_of_any_language(tmp_path: Path, site: str, name: str) -> None:
    path = tmp_path / f"{name}.ply"
    path.write_bytes(plys.binary_ply())
    id, _ = add_scene(str(path), tmp_path / "models", None, lambda share: None, LIMIT)
    assert list(scan_directory(tmp_path / "models")) == [id] == [name]


@pytest.mark.parametrize(
    ("path", "id", "words"),
    [
        ("nowhere.spz", None, "answers with 404"),
        ("letter.ply", None, "is not a scene"),
        ("short.ply", None, "is truncated"),
        ("there.ply", None, "There is a scene there already"),
        ("good.ply", "../../etc", "cannot be a scene's name"),
    ],
)
def test_what_cannot_be_added_leaves_nothing(tmp_path: Path, site: str, path: str, id: str | None, words: str) -> None:
    plys.write(tmp_path / "site" / "letter.ply", b"Dear reader, " * 10)
    plys.write(tmp_path / "site" / "short.ply", plys.binary_ply()[:-4])
    for name in ("there.ply", "good.ply"):
        plys.write(tmp_path / "site" / name, plys.binary_ply())
    plys.write(tmp_path / "models" / "there.ply", plys.binary_ply())
    for source in (f"{site}/{path}", str(tmp_path / "site" / path)):
        missing = words.startswith("answers") and not source.startswith("http")
        with pytest.raises((SceneNotAdded, BrokenScene), match="No such file" if missing else words):
            add_scene(source, tmp_path / "models", id, lambda _: None, LIMIT)
    assert [entry.name for entry in (tmp_path / "models").iterdir()] == ["there.ply"]


def test_nobody_at_home_is_said_in_a_sentence(tmp_path: Path, site: str) -> None:
    with pytest.raises(SceneNotAdded, match=r"^http://127\.0\.0\.1:1/a\.ply cannot be fetched: .+\.$"):
        add_scene("http://127.0.0.1:1/a.ply", tmp_path / "models", None, lambda _: None, LIMIT)


@pytest.mark.parametrize(
    ("path", "words"), [("endless.ply", "is larger than 0.001 GB; download it"), ("trickle.ply", "is too slow")]
)
def test_a_download_ends(tmp_path: Path, site: str, path: str, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library_operations, "TIMEOUT_S", 0.5)
    with pytest.raises(SceneNotAdded, match=words):
        add_scene(f"{site}/{path}", tmp_path / "models", None, lambda _: None, LIMIT)
    assert list((tmp_path / "models").iterdir()) == []


def test_a_file_that_is_said_to_be_too_large_is_not_fetched(tmp_path: Path, site: str) -> None:
    (tmp_path / "site" / "large.ply").write_bytes(bytes(LIMIT + 1))
    with pytest.raises(SceneNotAdded, match="is larger than"):
        add_scene(f"{site}/large.ply", tmp_path / "models", None, lambda _: pytest.fail("It was fetched."), LIMIT)


@pytest.mark.parametrize("address", ["{}/nowhere.ply?key=secret", "http://127.0.0.1:1/a.ply", "ftp://127.0.0.1/a.ply"])
def test_no_sentence_has_a_password(tmp_path: Path, site: str, address: str) -> None:
    source = address.format(site).replace("://", "://user:secret@")
    with pytest.raises(SceneNotAdded) as raised:
        add_scene(source, tmp_path / "models", None, lambda _: None, LIMIT)
    assert "secret" not in str(raised.value) + display_name(source)


@pytest.mark.parametrize("address", ["http://user:secret@[::1", "http://user:secret@a\u2100b/a.ply"])
def test_an_address_that_is_not_valid_is_refused_in_a_sentence(tmp_path: Path, address: str) -> None:
    for call in (lambda: add_scene(address, tmp_path, None, lambda _: None, LIMIT), lambda: display_name(address)):
        with pytest.raises(SceneNotAdded, match=r"^The scene's address is not valid\.$"):
            call()
    assert display_name("//[a") == "//[a", "a path"


@pytest.mark.slow
def test_a_command_that_is_terminated_leaves_nothing(tmp_path: Path, site: str) -> None:
    models = tmp_path / "models"
    environment = os.environ | {"TIGAS_RENDER_SCENES": str(models)}
    command = tigas_command("scene", "add", f"{site}/trickle.ply")
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE) as process:
        wait_until(lambda: models.is_dir() and list(models.glob(".*/trickle")))
        process.terminate()
        _, said = process.communicate(timeout=30)
    assert b"Traceback" not in said
    assert list(models.iterdir()) == []


def test_what_a_command_that_was_killed_has_left_is_removed_by_the_next(tmp_path: Path) -> None:
    models = tmp_path / "models"
    left = models / f"{PART_PREFIX}left"
    left.mkdir(parents=True)
    (left / "hall").write_bytes(b"ply")
    os.utime(left, (1e9, 1e9))
    add_scene(str(made_up.FILES / "shell.sog"), models, None, lambda _: None, LIMIT)
    assert [path.name for path in models.iterdir()] == ["shell.sog"]


@pytest.mark.parametrize(
    "change",
    [
        lambda folder: rename_scene(folder, "attic", "cellar"),
        lambda folder: edit_scene(folder, "attic", SceneEdit(up=(0, 1, 0))),
        lambda folder: remove_scene(folder, "attic"),
    ],
)
def test_changes_of_scenes_wait_for_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[[Path], None]
) -> None:
    (tmp_path / "attic.ply").write_bytes(b"")
    locked_out: list[bool] = []

    def looked_up(directory: Path) -> Any:
        try:
            with lock_directory(directory, LOCK_EX | LOCK_NB):
                locked_out.append(False)
        except OSError:
            locked_out.append(True)
        return directory_module.scene_paths(directory)

    monkeypatch.setattr(library_operations, "scene_paths", looked_up)
    change(tmp_path)
    assert locked_out
    assert all(locked_out)


def test_a_folder_that_cannot_be_deleted_is_an_error_but_no_longer_a_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "attic").mkdir()
    shutil.copy(made_up.FILES / "shell.sog", tmp_path / "attic")

    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "unlink", fail)
    with pytest.raises(OSError, match="Input/output error"):
        remove_scene(tmp_path, "attic")
    assert not (tmp_path / "attic").exists()


def test_a_name_changes_its_case_where_the_disk_ignores_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "garden.ply").write_bytes(plys.binary_ply())
    (tmp_path / "garden.scene.json").write_text('{"background": [0, 0, 1]}')

    def taken(*_: Path) -> None:
        raise FileExistsError(errno.EEXIST, "File exists")

    monkeypatch.setattr(Path, "exists", lambda _: True)  # as on such a disk
    monkeypatch.setattr(Path, "samefile", lambda *_: True)
    monkeypatch.setattr(library_operations, "move_new", taken)
    rename_scene(tmp_path, "garden", "Garden")
    assert (tmp_path / "Garden.ply").is_file()
    assert (tmp_path / "Garden.scene.json").read_text() == '{"background": [0, 0, 1]}'
