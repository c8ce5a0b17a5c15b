"""An experiment's blocks in several labs: shared out, reported, and ended with the command."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.command import tigas
from tests.experiments.run.test_plan import toml
from tigas_common.errors import StartError
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.run import labs

WORKER = """
import json, os, sys
from pathlib import Path
from tests.experiments.made_up import MACHINE
from tigas_experiments.records.folder import RunWriter, RunRecord
from tigas_experiments.run.experiment import Experiment
from tigas_experiments.run.labs import Answer, Job

job = Job.model_validate_json(sys.stdin.readline())
experiment = Experiment.from_plan(job.plan, Path(job.directory), Path(job.out))
if job.checks:
    experiment.write()
    Path(job.out, "checked").write_text(json.dumps(job.checks))
print(Answer().model_dump_json(), flush=True)
runs = {run.slug: run for run in experiment.runs}
for line in sys.stdin:
    for slug in json.loads(line):
        with Path(job.out, "log").open("a") as log:
            log.write(f"{os.getpid()} {slug}\\n")
        BEHAVIOUR
        record = RunRecord(configuration=runs[slug], machine=MACHINE, started="2026-11-27T15:00:00+00:00")
        record = RunWriter(experiment.folder(runs[slug]), record).close(
            status=status, problem=problem, inputs_sha256=experiment.inputs.digests(runs[slug])
        )
        print(Answer(record=record).model_dump_json(), flush=True)
"""
COMPLETE = 'status, problem = "complete", None'
BOTH_BEGIN = "while len({line.split()[0] for line in Path(job.out, 'log').open()}) < 2: os.sched_yield()"
"""Wait until another worker has a run, too."""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An experiment of three blocks with two runs each. Labs need no rights, and start at once."""
    monkeypatch.setattr(labs, "check_lab", lambda: None)
    monkeypatch.setattr(labs, "START_EVERY_S", 0)
    monkeypatch.setattr("tigas_experiments.report.cli.Report.run", lambda self: None)
    path = tmp_path / "small.toml"
    path.write_text(toml(networks=["20mbit", "5mbit", "1mbit"], controllers=["seen", "l2a"]))
    return path


@pytest.fixture
def behave(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Let workers do this instead of measuring a run."""

    def set_to(behaviour: str) -> None:
        program = tmp_path / "worker.py"
        program.write_text(WORKER.replace("BEHAVIOUR", behaviour))
        monkeypatch.setattr(labs, "NAMESPACES", ("sh", "-ec"))
        monkeypatch.setattr(labs, "SCRIPT", f'exec "{sys.executable}" "{program}"')
        monkeypatch.setenv("PYTHONPATH", str(Path.cwd()))

    set_to(COMPLETE)
    return set_to


def made(file: Path) -> dict[str, list[str]]:
    """The runs of each worker, in order."""
    found: dict[str, list[str]] = {}
    for line in (file.parent / "out" / "log").read_text().splitlines():
        worker, slug = line.split()
        found.setdefault(worker, []).append(slug)
    return found


def test_labs_share_an_experiment_by_blocks(file: Path, behave: Callable[[str], None]) -> None:
    behave(f"{BOTH_BEGIN}\n        {COMPLETE}")
    result = tigas("experiment", "run", file, "--out", file.parent / "out", "--labs", "2")
    assert result.exit_code == 0, result.output
    assert "All 6 runs are complete" in result.output
    by_worker = made(file)
    assert len(by_worker) == 2
    for slugs in by_worker.values():
        networks = [slug.split("_")[2] for slug in slugs]
        assert networks[::2] == networks[1::2], "runs that are compared follow each other in one lab"
    assert len({slug for slugs in by_worker.values() for slug in slugs}) == 6
    assert len(json.loads((file.parent / "out" / "checked").read_text())) == 6, "the first lab checks all runs"


def test_only_missing_runs_are_made_again(file: Path, behave: Callable[[str], None]) -> None:
    behave('status, problem = ("failed", "Lost.") if "5mbit" in slug else ("complete", None)')
    result = tigas("experiment", "run", file, "--out", file.parent / "out", "--labs", "3")
    assert result.exit_code == 1
    assert "2 of 6 runs are incomplete" in result.output
    assert ": Lost." in result.output
    (file.parent / "out" / "log").unlink()
    behave("import shutil; shutil.rmtree(experiment.folder(runs[slug]))\n        " + COMPLETE)
    assert tigas("experiment", "run", file, "--out", file.parent / "out", "--labs", "3").exit_code == 0
    assert [slug.split("_")[2] for slugs in made(file).values() for slug in slugs] == ["5mbit"] * 2
    records = [StoredRun(path.parent).record for path in (file.parent / "out").glob("runs/*/run.json")]
    assert {record.status for record in records} == {"complete"}


@pytest.mark.parametrize(
    ("behaviour", "sentence"),
    [
        ('sys.exit("The disk is full.")', "A lab ended: The disk is full."),
        ('print(Answer(problem="There is no scene.").model_dump_json(), flush=True)', "There is no scene."),
    ],
)
def test_a_lab_that_ends_ends_the_command_with_its_sentence(
    file: Path, behave: Callable[[str], None], behaviour: str, sentence: str
) -> None:
    behave(f"{behaviour}\n        {COMPLETE}")
    result = tigas("experiment", "run", file, "--out", file.parent / "out", "--labs", "2")
    assert result.exit_code != 0
    assert sentence in result.output
    assert "Traceback" not in result.output


def test_a_lab_that_is_killed_is_replaced_and_its_block_goes_on(file: Path, behave: Callable[[str], None]) -> None:
    die_once = 'if not Path(job.out, "killed").exists(): Path(job.out, "killed").touch(); os.kill(os.getpid(), 9)'
    behave(f"if '5mbit' in slug and '-l2a_' in slug:\n            {die_once}\n        {COMPLETE}")
    result = tigas("experiment", "run", file, "--out", file.parent / "out", "--labs", "2")
    assert result.exit_code == 0, result.output
    assert "All 6 runs are complete" in result.output
    slugs = [slug for slugs in made(file).values() for slug in slugs]
    assert len(set(slugs)) == 6
    assert len(slugs) == 7, "only the run that was lost is made again"


def test_a_lab_in_which_every_run_fails_gives_up(file: Path, behave: Callable[[str], None]) -> None:
    file.write_text(toml(networks=["20mbit", "5mbit", "1mbit"], controllers=["seen", "l2a", 0, 1]))
    behave('status, problem = "failed", "The screen is dark."')
    result = tigas("experiment", "run", file, "--out", file.parent / "out", "--labs", "2")
    assert "5 runs in a row failed in one lab, the last one: The screen is dark." in result.output
    assert sum(map(len, made(file).values())) < 12


def test_labs_and_the_url_of_services_exclude_each_other(file: Path) -> None:
    result = tigas("experiment", "run", file, "--labs", "2", "--url", "http://localhost:8080")
    assert "choose one" in result.output


def test_a_machine_that_cannot_run_the_lab_says_why(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise StartError("The lab creates network namespaces, which needs root: run it with sudo.")

    monkeypatch.setattr(labs, "check_lab", refuse)
    result = tigas("experiment", "run", file, "--out", file.parent / "out", "--labs", "2")
    assert "needs root" in result.output
