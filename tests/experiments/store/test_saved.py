"""An experiment saved by the page as a file is an ordinary one after its import."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.command import Result, tigas
from tests.experiments.store.conftest import upload
from tigas_experiments.records.folder import read_experiment
from tigas_experiments.records.summary import summarise
from tigas_experiments.report.cli import Report

FAILED: dict[str, Any] = {
    "status": "failed",
    "problem": "The connection was lost during the run.",
    "configuration": {"scene": "courtyard", "mode": "stateless"},  # the page did not know how large its stage was
    "recording": None,
    "link": [],
    "scene_bytes": None,
}


def saved(*runs: dict[str, Any], **changes: Any) -> str:
    """The page's file."""
    made = {"name": "My walk", "created": "2026-01-01T10:00:00.000Z", "source": "page", "plan": {"repeats": 2}}
    return json.dumps({**made, "runs": runs, **changes})


def complete(**changes: Any) -> dict[str, Any]:
    """A run in it."""
    return {"status": "complete", "problem": None, **upload(), **changes}


@pytest.fixture
def reported(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The folders that a report was asked for."""
    asked: list[Path] = []
    monkeypatch.setattr(Report, "run", lambda report: asked.append(report.folder))
    return asked


def tigas_import(directory: Path, text: str) -> Result:
    """`tigas experiment import walk.json --out results/walk`."""
    file = directory / "walk.json"
    file.write_text(text)
    return tigas("experiment", "import", file, "--out", directory / "results" / "walk")


def test_it_becomes_a_folder_that_reports_are_made_of(tmp_path: Path, reported: list[Path]) -> None:
    result = tigas_import(tmp_path, saved(complete(), FAILED, complete()))
    assert result.exit_code == 0, result.output
    out = tmp_path / "results" / "walk"
    assert reported == [out]
    record = read_experiment(out)
    assert (record.name, record.source, record.plan, record.planned) == ("My walk", "page", {"repeats": 2}, 3)
    runs = [summarise(folder) for folder in sorted((out / "runs").iterdir())]
    assert [run.folder for run in runs] == [f"0{n}_courtyard_stroll_20mbit-20ms-rtt_stateless-budget_0" for n in (1, 2)]
    assert [run.figures and run.figures.latencies.p50 for run in runs] == [40, 40]
    assert sorted(path.name for path in (tmp_path / "results").iterdir()) == ["walk"]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "walk.json is no experiment that the page saved: "),
        ("[]", "walk.json is no experiment that the page saved: "),
        (saved(complete(), name=" "), "walk.json is no experiment that the page saved: name: "),
        (saved(complete(), complete(scene_bytes=-1)), "walk.json, run 2: scene_bytes: input should be greater than"),
        (saved(complete(), {"recording": {}}), "walk.json, run 2: configuration: "),
        (saved(FAILED), "walk.json has no run that was recorded."),
    ],
)
def test_what_cannot_be_imported_leaves_nothing(tmp_path: Path, reported: list[Path], text: str, sentence: str) -> None:
    result = tigas_import(tmp_path, text)
    assert result.exit_code == 1
    assert sentence in result.output
    assert (reported, (tmp_path / "results").exists()) == ([], False)


def test_nothing_is_replaced(tmp_path: Path, reported: list[Path]) -> None:
    (tmp_path / "results" / "walk").mkdir(parents=True)
    assert "already exists" in tigas_import(tmp_path, saved(complete())).output
    assert list((tmp_path / "results" / "walk").iterdir()) == []
