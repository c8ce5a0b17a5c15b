"""Reports that are made again from their archives."""

from __future__ import annotations

import hashlib
import os
import shutil
import tarfile
from pathlib import Path

import pytest

from tests.experiments.report.synthetic_results import write_run
from tests.experiments.report.test_report import run_report
from tigas_common.errors import StartError
from tigas_experiments.records.folder import ExperimentRecord, write_experiment
from tigas_experiments.report.archive import PICTURES, Options, find_experiments, pack, read_options, unpack

EVALUATION = Path(__file__).with_name("evaluation.tar.xz")


def experiment(folder: Path) -> Path:
    """Two controllers that can be compared, and a run that broke off."""
    record = ExperimentRecord(name="It", created="2026-01-01T00:00:00Z", source="command", plan={})
    write_experiment(folder, record)
    write_run(folder / "runs" / "a", "latency", rtt_ms=20)
    write_run(folder / "runs" / "b", "seen", rtt_ms=300)
    write_run(folder / "runs" / "c", "seen", rtt_ms=20)
    write_run(folder / "runs" / "d", "seen", rtt_ms=20)
    (folder / "runs" / "c" / "frames.ndjson").unlink()
    return folder


def written(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file() and path.name != ".lock"}


@pytest.mark.slow
def test_a_report_is_made_again_byte_for_byte_without_telling_how(tmp_path: Path) -> None:
    folder, archive = experiment(tmp_path / "study"), tmp_path / "elsewhere" / "runs.tar.xz"
    archive.parent.mkdir()
    folder.joinpath("notes.md").write_text("not the report's")
    said = run_report(folder, "--archive", str(archive), "--baseline", "seen")
    assert said.exit_code == 0, said.output
    (folder / "notes.md").unlink()
    said = run_report(archive, "--archive", str(tmp_path / "again.tar.xz"))
    assert said.exit_code == 0, said.output
    again = written(archive.parent / "study")
    del again["options.json"], again["SHA256SUMS"]
    assert {"report.html", "runs.csv", "groups.csv", "differences.csv"} < set(again)
    assert {"headline.svg", "overview.svg", "01-bus_rtt.svg", "table.md", "overall.md"} < set(again)
    assert again == written(folder)
    assert (tmp_path / "again.tar.xz").read_bytes() == archive.read_bytes()


@pytest.mark.slow
def test_the_archive_of_several_experiments_gives_their_tables_and_figures_again(tmp_path: Path) -> None:
    """An evaluation of two short experiments of real runs, archived without pictures.

    After a change of reports: tigas report evaluation.tar.xz; tigas report paper --without-pictures --archive
    evaluation.tar.xz
    """
    archive, folder = tmp_path / "paper.tar.xz", tmp_path / "paper"
    shutil.copy(EVALUATION, archive)
    said = run_report(archive)
    assert said.exit_code == 0, said.output
    assert "All tables and figures are equal to the archived ones." in said.output
    listed = (folder / "SHA256SUMS").read_text()
    for name in ("best.md", "modes/runs.csv", "modes/overview.svg", "controllers/quality-heatmap.svg"):
        assert f"  {name}\n" in listed
    pack(
        folder,
        tmp_path / "again.tar.xz",
        {each: read_options(each) for each in find_experiments(folder)},
        pictures=False,
    )
    assert (tmp_path / "again.tar.xz").read_bytes() == EVALUATION.read_bytes()


def test_tables_that_differ_from_the_archived_ones_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, archive = experiment(tmp_path / "study"), tmp_path / "it.tar.xz"
    said = run_report(folder, "--archive", str(archive))
    assert said.exit_code == 0, said.output
    assert hashlib.sha256(archive.read_bytes()).hexdigest() in "".join(said.output.split())
    shutil.rmtree(folder)
    monkeypatch.setattr("tigas_experiments.report.report.overall_markdown", lambda _: "another version\n")
    said = run_report(archive)
    assert said.exit_code == 1
    assert "1 tables and figures differ from the archived ones, such as overall.md" in " ".join(said.output.split())


def test_pictures_and_files_beside_the_experiments(tmp_path: Path) -> None:
    one = experiment(tmp_path / "study" / "one")
    (tmp_path / "study" / "simulated").mkdir()
    (tmp_path / "study" / "simulated" / "table.txt").write_text("27.2 dB")
    for name in PICTURES:
        (one / "runs" / "a" / name).mkdir(exist_ok=True)
        (one / "runs" / "a" / name / "0.png").write_bytes(b"png")
    for pictures in (True, False):
        pack(tmp_path / "study", tmp_path / "it.tar.xz", {one: Options()}, pictures=pictures)
        with tarfile.open(tmp_path / "it.tar.xz") as tar:
            names = tar.getnames()
        assert "study/simulated/table.txt" in names
        assert sum(name.endswith("0.png") for name in names) == 2 * pictures


@pytest.mark.extended
def test_who_asks_for_another_report_of_an_archive_gets_it(tmp_path: Path) -> None:
    folder, archive = experiment(tmp_path / "study"), tmp_path / "it.tar.xz"
    run_report(folder, "--archive", str(archive), "--baseline", "seen")
    shutil.rmtree(folder)
    assert run_report(archive, "--baseline", "latency").exit_code == 0
    assert "Against Latency" in (folder / "report.html").read_text()
    assert run_report(folder).exit_code == 0
    assert "Against Seen" in (folder / "report.html").read_text(), "as the archive has it"
    (folder / "options.json").write_text('{"template": "comparison", "baseline": "latency"}')
    assert run_report(folder).exit_code == 0
    assert "Against Latency" in (folder / "report.html").read_text(), "early archives said which page to make"
    (folder / "options.json").write_text('{"baseline": 1}')
    said = run_report(folder)
    assert said.exit_code == 1
    assert "options.json cannot be read" in said.output


def test_equal_runs_give_equal_archives_whenever_and_whoever_wrote_them(tmp_path: Path) -> None:
    one = experiment(tmp_path / "one" / "study")
    two = tmp_path / "two" / "study"
    shutil.copytree(one, two, copy_function=shutil.copyfile)
    for path in two.rglob("*"):
        os.utime(path, (1, 1))
    (two / "runs" / "a" / "run.json").chmod(0o600)
    (two / "earlier").mkdir()
    (two / "notes.txt").write_text("not of the runs")
    for folder in (one, two):
        pack(folder, folder.parent / "it.tar.xz", {folder: Options()})
    assert (one.parent / "it.tar.xz").read_bytes() == (two.parent / "it.tar.xz").read_bytes()


def test_what_is_there_is_not_overwritten(tmp_path: Path) -> None:
    folder = experiment(tmp_path / "study")
    pack(folder, tmp_path / "it.tar.xz", {folder: Options()})
    with pytest.raises(StartError, match="study already exists"):
        unpack(tmp_path / "it.tar.xz")


def test_what_is_no_archive_gets_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "it.tar.xz"
    for content in (b"", b"no", b"\xfd7zXZ\x00 broken"):
        path.write_bytes(content)
        said = run_report(path)
        assert said.exit_code == 1
        assert "is not an archive of `tigas report --archive`" in said.output
    pack(study := experiment(tmp_path / "study"), path, {study: Options()})
    path.write_bytes(path.read_bytes()[:-200])
    shutil.rmtree(tmp_path / "study")
    said = run_report(path)
    assert said.exit_code == 1
    assert "Traceback" not in said.output


def test_an_archive_that_cannot_be_written_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, path = experiment(tmp_path / "study"), tmp_path / "it.tar.xz"
    path.write_bytes(b"old")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tarfile.TarFile.addfile", full)
    with pytest.raises(OSError, match="No space"):
        pack(folder, path, {folder: Options()})
    assert [each.name for each in tmp_path.iterdir() if each.is_file()] == ["it.tar.xz"]
    assert path.read_bytes() == b"old"


def test_an_archive_that_grows_without_measure_is_not_unpacked(tmp_path: Path) -> None:
    folder = experiment(tmp_path / "study")
    (folder / "runs" / "a" / "load.ndjson").write_bytes(bytes(100_000_000))
    pack(folder, tmp_path / "bomb.tar.xz", {folder: Options()})
    shutil.rmtree(folder)
    with pytest.raises(StartError, match=r"bomb\.tar\.xz would unpack to more than 1,000 times its size\."):
        unpack(tmp_path / "bomb.tar.xz")
    assert not folder.exists()
