"""What is added to a models directory is a scene there, and what cannot be leaves nothing behind."""

from __future__ import annotations

import threading
import zipfile
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from tests.render.scenes import made_up, plys
from tigas_common.errors import BrokenScene
from tigas_render.scenes.adding import NotAdded, add_scene
from tigas_render.scenes.directory import scan_directory


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


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
    id, file = add_scene(str(made_up.FILES / name), models, None, lambda _: None)
    assert file.files == (models / stored,)
    assert [path.name for path in models.iterdir()] == [stored]
    assert scan_directory(models)[id].gaussians == made_up.COUNT


def test_what_a_file_is_decides_its_ending_and_it_may_be_called_otherwise(tmp_path: Path) -> None:
    odd = plys.write(tmp_path / "download.bin", (made_up.FILES / "shell-4.spz").read_bytes())
    assert add_scene(str(odd), tmp_path / "models", "attic", lambda _: None)[0] == "attic"
    assert [path.name for path in (tmp_path / "models").iterdir()] == ["attic.spz"]


@pytest.mark.parametrize("named", ["hall", "hall/meta.json"])
def test_a_folder_of_images_becomes_one_file(tmp_path: Path, named: str) -> None:
    with zipfile.ZipFile(made_up.FILES / "shell.sog") as bundle:
        bundle.extractall(tmp_path / "hall")
    id, file = add_scene(str(tmp_path / named), tmp_path / "models", None, lambda _: None)
    assert (id, file.format, [path.name for path in file.files]) == ("hall", "SOG", ["hall.sog"])
    assert len(file.load()) == made_up.COUNT


def test_a_scene_is_fetched(tmp_path: Path, site: str) -> None:
    plys.write(tmp_path / "site" / "my shell.spz", (made_up.FILES / "shell-3.spz").read_bytes())
    heard: list[float] = []
    id, file = add_scene(f"{site}/my%20shell.spz?version=2", tmp_path / "models", None, heard.append)
    assert (id, file.count, heard[-1]) == ("my shell", made_up.COUNT, 1.0)


@pytest.mark.parametrize(
    ("path", "id", "words"),
    [
        ("nowhere.spz", None, "answers with 404"),
        ("letter.ply", None, "is no scene"),
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
        with pytest.raises((NotAdded, BrokenScene), match="No such file" if missing else words):
            add_scene(source, tmp_path / "models", id, lambda _: None)
    assert [entry.name for entry in (tmp_path / "models").iterdir()] == ["there.ply"]


def test_nobody_at_home_is_said_in_a_sentence(tmp_path: Path, site: str) -> None:
    with pytest.raises(NotAdded, match=r"^http://127\.0\.0\.1:1/a\.ply cannot be fetched: .+\.$"):
        add_scene("http://127.0.0.1:1/a.ply", tmp_path / "models", None, lambda _: None)
