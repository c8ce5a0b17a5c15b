"""The list of published sets, and lists that are wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from tigas_shaper.traces.sources import FetchError, load_sources


def test_the_list_that_tigas_brings_is_sound() -> None:
    sources = load_sources()
    assert set(sources) == {"ghent-4g", "irish-5g", "mahimahi", "sabre-4g"}
    for source in sources.values():
        assert all(file.url.startswith("https://") for file in source.files)
        assert len({file.name for file in source.files}) == len(source.files)


FILE = 'title = "t"\npage = "p"\nlicence = "l"\ncite = "c"\n'


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
