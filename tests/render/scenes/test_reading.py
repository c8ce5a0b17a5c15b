"""Reading in a process of its own: the same Gaussians and errors as here, and no process is left."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import psutil
import pytest

from reference.ply import write_ply
from tests.render.scenes import plys
from tests.render.scenes.test_ply import assert_same
from tigas_common.errors import BrokenScene
from tigas_render.scenes import reading
from tigas_render.scenes.directory import read_scene_file, read_source

COUNT = 10_000


@pytest.fixture
def large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(reading, "LARGE", COUNT)
    path = tmp_path / "large.ply"
    write_ply(path, plys.gaussians(COUNT, sh_degree=1))
    return path


def children() -> list[psutil.Process]:
    return psutil.Process().children(recursive=True)


def test_a_large_scene_is_read_by_another_process_and_is_the_same(large: Path) -> None:
    shares: list[float] = []
    readers: list[int] = []

    def listen(share: float) -> None:
        shares.append(share)
        readers.extend(child.nice() for child in children())

    gaussians = reading.read(read_source(large), listen).gathered()
    assert_same(gaussians, read_scene_file(large).load())
    assert shares == sorted(shares)
    assert shares[-1] == 1
    assert max(readers) > os.getpriority(os.PRIO_PROCESS, 0), "it has a lower priority"
    assert not children()


def test_a_file_that_is_cut_off_while_it_is_read_is_a_sentence(large: Path) -> None:
    scene = reading.read(read_source(large), lambda _: None)
    os.truncate(large, large.stat().st_size - 100)
    with pytest.raises(BrokenScene, match=r"large\.ply is truncated"):
        scene.gathered()


def test_a_reader_that_is_killed_is_a_sentence(large: Path) -> None:
    def kill(_: float) -> None:
        for child in children():
            child.send_signal(signal.SIGKILL)

    with pytest.raises(BrokenScene, match="could not be read: the process that read it was ended"):
        reading.read(read_source(large), kill).gathered()


def test_loading_that_is_given_up_ends_the_reader(large: Path) -> None:
    def give_up(_: float) -> None:
        raise TimeoutError

    with pytest.raises(TimeoutError):
        reading.read(read_source(large), give_up).gathered()
    assert not children()
