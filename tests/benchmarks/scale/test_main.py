"""The command, and docs/scale.md, which has what it prints."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.scale.__main__ import main

DOCUMENT = Path(__file__).parents[3] / "docs/scale.md"


def test_the_document_has_the_tables_of_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    tables = capsys.readouterr().out.strip().split("\n\n")
    assert len(tables) == 5
    text = DOCUMENT.read_text()
    for table in tables:
        assert table in text, "docs/scale.md is not what `python -m benchmarks.scale` prints"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--cores", "0"], "serves nobody"),
        (["--regions", "missing.toml"], "missing.toml has no list of regions"),
        (["--regions", "half.toml"], "are 0.5 together, not 1"),
    ],
)
def test_what_cannot_be_planned_is_said_in_a_sentence(
    arguments: list[str],
    sentence: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("half.toml").write_text('[[region]]\nname = "here"\nshare = 0.5\nradius_km = 1000\n')
    assert main(arguments) == 1
    assert sentence in capsys.readouterr().err
