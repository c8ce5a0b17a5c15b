"""Archives from strangers."""

from __future__ import annotations

import io
import stat
import zipfile
from pathlib import Path

import pytest

from tests.shaper.traces.files import names
from tigas_shaper.traces import unpack as unpack_module
from tigas_shaper.traces.sources import FetchError
from tigas_shaper.traces.unpack import unpack


def archive(path: Path, members: dict[str, bytes], link: str | None = None) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            info = zipfile.ZipInfo(name)
            info.external_attr = ((stat.S_IFLNK if name == link else stat.S_IFREG) | 0o644) << 16
            file.writestr(info, content, zipfile.ZIP_DEFLATED)
    return path


def test_an_archive_is_unpacked_beside_itself_once(tmp_path: Path) -> None:
    path = archive(tmp_path / "set.zip", {"set/a.log": b"1", "set/deep/b.log": b"2"})
    folder = unpack(path)
    assert (folder / "set" / "deep" / "b.log").read_bytes() == b"2"
    assert names(tmp_path) == {"set.zip", "set"}
    (folder / "note").touch()
    assert unpack(path) == folder
    assert (folder / "note").exists()


@pytest.mark.parametrize(
    ("member", "link", "sentence"),
    [
        ("../evil", False, "'../evil' would be written elsewhere"),
        ("a/../../evil", False, "would be written elsewhere"),
        ("/tmp/evil", False, "would be written elsewhere"),
        ("..\\evil", False, "would be written elsewhere"),
        ("C:evil", False, "would be written elsewhere"),
        ("way", True, "'way' is a link"),
    ],
)
def test_an_archive_that_reaches_outside_is_refused_and_nothing_is_left(
    member: str, link: bool, sentence: str, tmp_path: Path
) -> None:
    path = archive(tmp_path / "set.zip", {"fine.log": b"1", member: b"../.."}, member if link else None)
    with pytest.raises(FetchError) as error:
        unpack(path)
    assert sentence in error.value.detail
    assert names(tmp_path) == {"set.zip"}
    assert not (tmp_path.parent / "evil").exists()


def test_a_zip_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unpack_module, "MAX_BYTES", 1_000_000)
    path = archive(tmp_path / "set.zip", {"bomb": b"\0" * 2_000_000})
    assert path.stat().st_size < 10_000
    with pytest.raises(FetchError, match="holds more than"):
        unpack(path)
    assert names(tmp_path) == {"set.zip"}


def test_a_damaged_archive_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    path = archive(tmp_path / "set.zip", {"a.log": bytes(range(256)) * 100})
    damaged = bytearray(path.read_bytes())
    damaged[60:90] = b"\0" * 30
    for content in (bytes(damaged), b"no zip at all", path.read_bytes()[:-30]):
        path.write_bytes(content)
        with pytest.raises(FetchError, match="cannot be unpacked"):
            unpack(path)
        assert names(tmp_path) == {"set.zip"}


def test_names_that_appear_twice_in_an_archive_are_refused(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        file.writestr("a", b"1")
        with pytest.warns(UserWarning, match="Duplicate name"):
            file.writestr("a", b"2")
    (tmp_path / "set.zip").write_bytes(buffer.getvalue())
    with pytest.raises(FetchError, match="cannot be unpacked"):
        unpack(tmp_path / "set.zip")
