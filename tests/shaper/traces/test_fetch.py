"""Published sets of traces: their list, and their archives."""

from __future__ import annotations

import io
import stat
import zipfile
from pathlib import Path

import pytest

from tigas_common.downloads import FetchError
from tigas_shaper.traces.fetch import load_sources, unpack

FILE = 'title = "t"\npage = "p"\nlicence = "l"\ncite = "c"\n'


def names(directory: Path) -> set[str]:
    return {path.name for path in directory.iterdir()}


def test_the_list_that_tigas_brings_is_sound() -> None:
    sources = load_sources()
    assert set(sources) == {"ghent-4g", "irish-5g", "mahimahi", "sabre-4g"}
    for source in sources.values():
        assert all(file.url.startswith("https://") for file in source.files)
        assert len({file.name for file in source.files}) == len(source.files)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[a", "cannot be read"),
        ("a = 1", "cannot be read"),
        (f"[a]\n{FILE}files = []", "cannot be read"),
        (f'[a]\n{FILE}files = [{{ url = "https://x/y", sha256 = "abc" }}]', "cannot be read"),
        (f'["../a"]\n{FILE}files = [{{ url = "https://x/y" }}]', "'../a' in the list of trace sets cannot be the name"),
        (f'[a]\n{FILE}files = [{{ url = "https://x/%2e%2e" }}]', "'..' in the list"),
        (f'[a]\n{FILE}files = [{{ url = "https://x/..%5Cy" }}]', "cannot be the name of a file"),
        (f'[a]\n{FILE}files = [{{ url = "https://x/" }}]', "'' in the list"),
        (f'[a]\n{FILE}files = [{{ url = "file:///etc/passwd" }}]', "is not an HTTP address"),
    ],
)
def test_a_list_that_is_wrong_or_reaches_outside_is_refused(text: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "sources.toml"
    path.write_text(text)
    with pytest.raises(FetchError) as error:
        load_sources(path)
    assert sentence in error.value.detail


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
    monkeypatch.setattr("tigas_shaper.traces.fetch.MAX_UNPACKED_BYTES", 1_000_000)
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
