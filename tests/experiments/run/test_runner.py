"""Interrupted experiments: complete runs are kept, and only missing ones are repeated.

Measuring is a stub here; `test_cli.py` does it in a real browser.
"""

from __future__ import annotations

import errno
import io
import json
import shutil
import signal
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from tests.command import Result
from tests.command import tigas as in_process
from tests.experiments.conftest import Stub, fails
from tests.experiments.made_up import MACHINE, SERVER
from tests.experiments.run.test_plan import toml
from tigas_common.errors import StartError
from tigas_experiments.lock import hold_lock
from tigas_experiments.records.folder import RunRecord, RunWriter, read_experiment
from tigas_experiments.records.machine import Server
from tigas_experiments.report.controllers import run_names
from tigas_experiments.run.experiment import GIVE_UP_AFTER, Experiment
from tigas_experiments.run.plan import ExperimentPlan
from tigas_experiments.run.runner import progress


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(toml(controllers=["latency", "l2a", 0], repeats=2))
    return path


def tigas(command: str, file: Path, *arguments: str) -> Result:
    """`tigas experiment COMMAND FILE --out out`, next to the file."""
    return in_process("experiment", command, file, "--out", file.parent / "out", *arguments)


def status(file: Path) -> dict[str, str]:
    """Of each run: its status, or its problem."""
    found = {}
    for path in (file.parent / "out" / "runs").glob("*/run.json"):
        record = json.loads(path.read_text())
        found[path.parent.name] = record["problem"] or record["status"]
    return found


def test_a_second_run_makes_nothing_again(stub: Stub, file: Path) -> None:
    result = tigas("run", file)
    assert result.exit_code == 0, result.output
    assert len(stub.made) == 6
    assert set(status(file).values()) == {"complete"}
    record = read_experiment(file.parent / "out")
    assert (record.name, record.source, record.plan["repeats"], record.planned) == ("small", "command", 2, 6)
    again = tigas("run", file)
    assert again.exit_code == 0
    assert "All 6 runs are complete" in again.output
    assert (len(stub.made), stub.checked) == (6, 1), "nothing is even started"
    assert stub.reported == [file.parent / "out"] * 2
    assert read_experiment(file.parent / "out") == record


def test_a_run_that_fails_is_marked_and_alone_repeated(stub: Stub, file: Path) -> None:
    stub.happenings = [None, fails]
    result = tigas("run", file)
    assert result.exit_code == 1
    assert "1 of 6 runs are incomplete. To repeat them: tigas" in result.output
    failed = stub.made[1]
    assert "2/6 Stateless " in result.output
    assert ", repeat 1: The viewer failed: Target closed" in result.output
    assert status(file)[failed] == "The viewer failed: Target closed"
    assert list(status(file).values()).count("complete") == 5, "the others go on"
    assert f"missing   {failed}" in tigas("plan", file).output
    assert tigas("run", file).exit_code == 0
    assert stub.made[6:] == [failed]
    kept = json.loads((file.parent / "out" / "earlier" / f"{failed}.1" / "run.json").read_text())
    assert kept["status"] == "failed", "the attempt is kept where no report reads it"


@pytest.mark.parametrize(
    "content",
    ["", '{"status": "comp', '{"status": "running"}', "[]", "killed", None],
    ids=lambda text: text or repr(text),
)
def test_a_truncated_record_is_repeated(stub: Stub, file: Path, content: str | None) -> None:
    tigas("run", file)
    path = file.parent / "out" / "runs" / stub.made[2] / "run.json"
    whole = path.read_text()
    path.unlink()
    if content is not None:
        path.write_text(whole.replace('"complete"', '"running"') if content == "killed" else content)
    assert tigas("run", file).exit_code == 0
    assert stub.made[6:] == [stub.made[2]]


def test_the_services_are_started_with_the_ladder_that_the_file_asks_for(stub: Stub, file: Path) -> None:
    tigas("run", file)
    assert stub.ladder == "scene"
    shutil.rmtree(file.parent / "out")
    file.write_text(toml(ladder="paper"))
    assert tigas("run", file).exit_code == 0
    assert stub.ladder == "paper"
    file.write_text(toml(ladder="mine"))
    assert "ladder: input should be 'scene' or 'paper'" in tigas("run", file).output


def test_other_configurations_are_made_again_and_the_old_ones_kept(stub: Stub, file: Path) -> None:
    tigas("run", file)
    file.write_text(toml(controllers=["latency", "l2a", 0], repeats=2, duration_s=30))
    assert tigas("run", file).exit_code == 0
    assert stub.made[6:] == stub.made[:6]
    assert len(list((file.parent / "out" / "earlier").iterdir())) == 6


@pytest.fixture
def of_files(tmp_path: Path) -> Path:
    """An experiment of four runs: a movement's file and a generated one, over a trace's file and a constant link."""
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "walk.csv").write_text("a walk")
    (folder / "bus.csv").write_text("a bus")
    path = folder / "small.toml"
    path.write_text(toml(movements=["walk.csv", "stroll"], networks=["bus.csv", "20mbit"]))
    return path


def test_a_folder_that_moved_has_all_its_runs(stub: Stub, of_files: Path) -> None:
    assert tigas("run", of_files).exit_code == 0
    moved = of_files.parent.rename(of_files.parent.with_name("moved")) / of_files.name
    assert "4 runs, 0 missing" in tigas("plan", moved).output


@pytest.mark.parametrize("name", ["walk", "bus"])
def test_what_was_made_from_another_file_is_made_again(stub: Stub, of_files: Path, name: str) -> None:
    tigas("run", of_files)
    (of_files.parent / f"{name}.csv").write_text("another")
    assert tigas("run", of_files).exit_code == 0
    assert len(stub.made) == 6
    assert all(name in slug for slug in stub.made[4:])
    assert len(list((of_files.parent / "out" / "earlier").iterdir())) == 2
    assert "4 runs, 0 missing" in tigas("plan", of_files).output


def test_runs_of_old_that_say_nothing_of_their_inputs_are_complete(stub: Stub, of_files: Path) -> None:
    tigas("run", of_files)
    for path in (of_files.parent / "out" / "runs").glob("*/run.json"):
        record = json.loads(path.read_text())
        del record["inputs_sha256"], record["server"]
        configuration = record["configuration"]
        if configuration["movement"] == "walk.csv":
            configuration["movement"] = "/then/walk.csv"  # the whole path
        if configuration["network"]["trace_file"]:
            configuration["network"]["trace_file"] = "/then/bus.csv"
        path.write_text(json.dumps(record))
    assert "4 runs, 0 missing" in tigas("plan", of_files).output


def test_an_experiment_may_grow_but_not_become_another(stub: Stub, file: Path) -> None:
    tigas("run", file)
    file.write_text(toml(controllers=["latency", "l2a", 0, "lol+"], repeats=2))
    assert tigas("run", file).exit_code == 0
    assert len(stub.made) == 8
    before = status(file)
    file.write_text(toml(controllers=["latency"], repeats=2))
    result = tigas("run", file)
    assert result.exit_code == 1
    assert "has 6 runs of another experiment, such as courtyard_stroll_4g-bus_stateless-0_0" in result.output
    assert status(file) == before


@pytest.mark.parametrize(
    ("name", "now", "sentence"),
    [
        ("commit", "abd", "another commit (abc, now abd): choose another --out, or --allow-changes"),
        ("browser", "157", "another browser (156, now 157)"),
        ("scene_bytes", 1001, "another scene courtyard (1,000 bytes, now 1,001 bytes)"),
        ("scene_sha256", "b" * 64, "another scene courtyard (SHA-256 aaaaaaaaaaaa…, now SHA-256 bbbbbbbbbbbb…)"),
        (
            "server",
            Server.from_config(SERVER.model_copy(update={"ladder": SERVER.ladder[:1]})),
            "another ladder (1280x720 q90, ",
        ),
        ("scene_ladder", SERVER.ladder[1:2], "another ladder (1280x720 q90, "),
        (
            "server",
            Server.from_config(SERVER.model_copy(update={"commit": "abd"})),
            "another render service's commit (abc, now abd)",
        ),
        (
            "server",
            Server.from_config(SERVER.model_copy(update={"tcp_congestion_control": "bbr"})),
            "another TCP congestion control (cubic, now bbr)",
        ),
    ],
)
def test_what_was_changed_since_is_not_taken_together_unseen(
    stub: Stub, file: Path, name: str, now: object, sentence: str
) -> None:
    stub.happenings = [None, fails]
    tigas("run", file)
    before = status(file)
    setattr(stub, name, now)
    result = tigas("run", file)
    assert result.exit_code == 1
    assert sentence in result.output
    assert (len(stub.made), status(file)) == (6, before), "nothing is made"
    assert tigas("run", file, "--allow-changes").exit_code == 0
    assert len(stub.made) == 7


def test_with_nothing_kept_or_known_nothing_has_changed(stub: Stub, file: Path) -> None:
    stub.happenings = [fails] * 5
    tigas("run", file)
    stub.browser = "157"
    assert tigas("run", file).exit_code == 0, "no run was complete"
    for path in (file.parent / "out" / "runs").glob("*0/run.json"):
        record = json.loads(path.read_text())
        for key in ("server", "scene_bytes", "scene_sha256"):
            del record[key]
        record["machine"]["commit"] = record["browser"] = None
        path.write_text(json.dumps(record))
    for path in (file.parent / "out" / "runs").glob("*1/run.json"):
        path.unlink()
    stub.browser, stub.commit, stub.scene_bytes = "158", "abd", 5
    assert tigas("run", file).exit_code == 0, "early runs say nothing"


def test_ctrl_c_marks_the_run_and_says_how_to_go_on(stub: Stub, file: Path) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        stub.made.clear()
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell does for a script's background jobs
        stub.happenings = [None, lambda _, number=number: signal.raise_signal(number)]  # type: ignore[misc]
        result = tigas("run", file)
        assert result.exit_code == 130, result.output
        assert "Interrupted. To resume: tigas" in result.output
        assert status(file)[stub.made[1]] == "The run was stopped before it ended."
        assert len(stub.made) == 2
    stub.made.clear()
    assert tigas("run", file).exit_code == 0
    assert len(stub.made) == 4


def test_many_failures_in_a_row_end_it(stub: Stub, file: Path) -> None:
    stub.happenings = [fails] * 6
    result = tigas("run", file)
    assert result.exit_code == 1
    assert len(stub.made) == GIVE_UP_AFTER == 5
    assert "5 runs in a row failed, so the others are not tried; run the same command to continue." in result.output
    assert result.output.endswith("failure: The viewer failed: Target closed\n")
    file.write_text(toml(controllers=["latency", "l2a", 0], repeats=4))
    stub.happenings = [fails, fails, None] * 4
    assert "8 of 12 runs are incomplete" in tigas("run", file).output, "failures among others do not"


@pytest.mark.parametrize("mark", [True, False], ids=["a mark fits", "no mark fits"])
def test_a_full_disk_costs_its_runs_alone(stub: Stub, file: Path, monkeypatch: pytest.MonkeyPatch, mark: bool) -> None:
    full = OSError(errno.ENOSPC, "No space left on device")

    def out_of_space(writer: RunWriter) -> None:
        if not mark:
            monkeypatch.setattr(writer, "close", lambda **_: (_ for _ in ()).throw(full))
        raise full

    stub.happenings = [None, out_of_space]
    result = tigas("run", file)
    assert result.exit_code == 1
    assert "could not be written: [Errno 28] No space left on device" in result.output
    assert "Traceback" not in result.output
    assert "complete" not in status(file)[stub.made[1]]
    assert len(stub.made) == 6
    assert tigas("run", file).exit_code == 0
    assert stub.made[6:] == [stub.made[1]]


def test_a_disk_that_is_full_from_the_start(stub: Stub, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_room(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(RunWriter, "__init__", no_room)
        result = tigas("run", file)
    assert result.exit_code == 1
    assert "5 runs in a row failed" in result.output
    assert tigas("run", file).exit_code == 0


def test_two_experiments_do_not_share_a_folder(stub: Stub, file: Path) -> None:
    out = file.parent / "out"
    out.mkdir()
    with hold_lock(out / ".lock", ""):
        result = tigas("run", file)
    assert result.exit_code == 1
    assert "Another experiment is writing into" in result.output
    assert stub.made == []
    assert [path.name for path in out.iterdir()] == [".lock"]


def test_what_cannot_be_begun_changes_nothing(stub: Stub, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def check(_: object) -> None:
        raise StartError("The scene 'courtyard' cannot be loaded: no.")

    monkeypatch.setattr(stub, "check", check)
    result = tigas("run", file)
    assert result.exit_code == 1
    assert "cannot be loaded" in result.output
    assert not (file.parent / "out").exists()


def test_nonsense_gets_one_sentence(file: Path, stub: Stub) -> None:
    file.write_text("scenes = 1")
    for command in ("plan", "run"):
        result: Any = tigas(command, file)
        assert result.exit_code == 1
        assert "Traceback" not in result.output
        assert not (file.parent / "out").exists()


PLAN = {
    "name": "compare",
    "scenes": ["courtyard"],
    "movements": ["stroll"],
    "networks": ["20mbit,20ms-rtt"],
    "modes": ["stateless", "dash-tuned"],
    "shuffled": False,
}


def seen(console: Console, folder: Path, done: int = 0) -> None:
    """One run, after a number of others."""
    made = Experiment.from_plan(ExperimentPlan.from_data(PLAN, "here"), folder, Path("out"), "tigas experiment run")
    with progress(made, made.runs[done:], run_names(made.runs), console) as listener:
        listener.on_stage("starting the services")
        listener.on_begin(made.runs[done])
        listener.on_stage("comparing with ground truth")
        listener.on_finish(
            RunRecord(status="complete", problem=None, configuration=made.runs[done], machine=MACHINE, started="now")
        )


def test_a_log_says_how_long_it_takes_and_has_a_line_a_run(tmp_path: Path) -> None:
    log = io.StringIO()
    seen(Console(file=log, width=80), tmp_path)
    seen(Console(file=log, width=80), tmp_path, done=1)
    assert [line for line in log.getvalue().splitlines() if line] == [
        "2 runs, about 50 seconds, into out",
        "1/2 Stateless seen, 20mbit,20ms-rtt, stroll",
        "1 of 2 runs, about 25 seconds, into out",
        "2/2 DASH tuned, 20mbit,20ms-rtt, stroll",
    ]


def test_a_terminal_shows_the_whole_name_of_the_run_that_is_made(tmp_path: Path) -> None:
    for width in (80, 50):
        screen = io.StringIO()
        seen(Console(file=screen, width=width, force_terminal=True, color_system=None), tmp_path)
        words = screen.getvalue().split()
        for word in ("1/2", "Stateless", "seen,", "20mbit,20ms-rtt,", "stroll:", "ground", "truth"):
            assert word in words
        assert "…" not in screen.getvalue()
