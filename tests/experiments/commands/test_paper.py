"""`tigas paper` as a person uses it; runs are pretended."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from tests.command import Result, tigas
from tests.experiments.conftest import Stub, fails
from tests.experiments.run.test_plan import EXPERIMENTS
from tests.prerequisites import ROOT_RIGHTS
from tigas_experiments.commands.paper import Evaluation

FILE = """
[experiment]
scenes = ["courtyard"]
movements = ["stroll"]
networks = ["20mbit"]
controllers = ["seen", "l2a"]

[[parts]]
name = "short"
shows = "controllers"
minutes = 1
[parts.experiment]
duration_s = 5

[[parts]]
name = "scored"
shows = "scores"
minutes = 1
like = "short"
then = ["echo scored >>{out}/scores.txt", "test ! -e {out}/broken"]
[parts.experiment]
rtts_ms = [20]

[[parts]]
name = "of-people"
shows = "people"
minutes = 1
[parts.experiment]
movements = ["recorded/walk.csv"]

[[parts]]
name = "simulated"
shows = "figures"
minutes = 1
then = ["cat {data}/figures.txt >{out}/table.txt"]

[inputs]
"experiments/recorded/walk.csv" = "cat {data}/walk.csv >{path}"
"""
WALK = "t_ms,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n30000,0,0,1,0,0,0,1\n"


@pytest.fixture(autouse=True)
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "experiments").mkdir()
    (tmp_path / "experiments" / "paper.toml").write_text(FILE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def paper(*arguments: str) -> Result:
    return tigas("paper", *arguments, columns=200)


def progress(part: str) -> dict[str, object]:
    found: dict[str, object] = json.loads(Path("results", "paper", part, "part.json").read_text())
    return found


def test_a_part_is_made_once_and_listed_as_done(stub: Stub) -> None:
    assert [line.split("│")[-2].strip() for line in paper().output.splitlines() if "about 1" in line] == [""] * 4
    assert paper("short").exit_code == 0
    assert len(stub.made) == 2
    assert stub.reported == [Path("results", "paper", "short")]
    again = paper("short")
    assert (again.exit_code, len(stub.made)) == (0, 2)
    assert "results/paper/short is complete." in again.output
    assert len(stub.reported) == 1
    (listed,) = [line for line in paper().output.splitlines() if "short" in line]
    assert listed.split("│")[-2].strip() == "yes"


def test_what_sudo_made_belongs_to_its_caller(stub: Stub, monkeypatch: pytest.MonkeyPatch) -> None:
    if os.geteuid() != 0:
        ROOT_RIGHTS.skip()
    monkeypatch.setenv("SUDO_UID", "1234")
    monkeypatch.setenv("SUDO_GID", "1234")
    assert paper("short").exit_code == 0
    made = Path("results", "paper", "short")
    assert {path.stat().st_uid for path in (made, *made.rglob("*"))} == {1234}


def test_a_part_that_broke_off_is_continued(stub: Stub) -> None:
    stub.happenings = [None, fails]
    assert paper("short").exit_code == 1
    assert progress("short")["done"] is False
    assert paper("short").exit_code == 0
    assert len(stub.made) == 3, "the failed run alone"
    assert progress("short")["done"] is True


def test_commands_follow_the_runs_and_a_broken_one_is_repeated_alone(stub: Stub) -> None:
    folder = Path("results", "paper", "scored")
    folder.mkdir(parents=True)
    (folder / "broken").touch()
    stopped = paper("scored")
    assert stopped.exit_code == 1
    assert "scored stopped because this failed: test ! -e results/paper/scored/broken" in stopped.output
    assert progress("scored")["done"] is False
    (folder / "broken").unlink()
    assert paper("scored").exit_code == 0
    assert progress("scored")["done"] is True
    assert len(stub.reported) == 3, "after the commands once more"
    assert (folder / "scores.txt").read_text() == "scored\n" * 2
    assert len(stub.made) == 2, "the runs are kept"


def test_inputs_are_made_from_the_folder_of_recordings(stub: Stub, repository: Path) -> None:
    missing = paper("of-people")
    assert missing.exit_code == 1
    assert "name their folder with --data (make paper PART=of-people DATA=../shared" in " ".join(missing.output.split())
    assert paper("of-people", "--data", str(repository)).exit_code == 1
    assert not Path("experiments", "recorded", "walk.csv").exists(), "nothing half-made is left"
    (repository / "walk.csv").write_text(WALK)
    assert paper("of-people", "--data", str(repository)).exit_code == 0
    assert len(stub.made) == 2
    (repository / "walk.csv").unlink()
    assert paper("of-people").exit_code == 0, "they are made once"


def test_a_part_may_be_commands_alone(repository: Path) -> None:
    data = repository / "my recordings"
    data.mkdir()
    (data / "figures.txt").write_text("27.2 dB")
    assert paper("simulated", "--data", str(data)).exit_code == 0
    assert Path("results", "paper", "simulated", "table.txt").read_text() == "27.2 dB"
    assert "is complete" in paper("simulated").output


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("magic",), "There is no part 'magic'; the parts are short, scored, of-people, simulated."),
        (("--file", "nothing.toml"), "nothing.toml cannot be read (No such file or directory)"),
    ],
)
def test_nonsense_gets_one_sentence(arguments: tuple[str, ...], sentence: str) -> None:
    result = paper(*arguments)
    assert result.exit_code == 1
    assert sentence in result.output


def test_the_published_parts_can_make_everything_that_they_name() -> None:
    evaluation = Evaluation.read(EXPERIMENTS / "paper.toml")
    for part in evaluation.parts:
        plan = evaluation.plan(part)
        if plan is not None:
            recorded = {name for name in (*plan.movements, *plan.networks) if name.startswith("recorded/")}
            scenes = {f"models/{scene}" for scene in plan.scenes if scene != "courtyard"}
            made = evaluation.needed_inputs(part)
            assert recorded == {path.removeprefix("experiments/") for path in made if path.startswith("experiments/")}
            assert scenes == {str(Path(path).parent) for path in made if path.startswith("models/")}
