"""The render service that a training starts for itself: it answers, and never outlives the training."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from tests.prerequisites import SETPRIV
from tigas_enhance.renderer import RenderFailed, render_service

TRAINING = """
import time
from tigas_enhance.renderer import render_service
with render_service("cpu") as url:
    print(url, flush=True)
    time.sleep(600)
"""


@pytest.mark.slow
@SETPRIV.mark
def test_it_ends_with_a_training_that_is_killed() -> None:
    with subprocess.Popen([sys.executable, "-c", TRAINING], stdout=subprocess.PIPE) as training:
        assert training.stdout is not None
        try:
            assert training.stdout.readline().startswith(b"http://")
            services = psutil.Process(training.pid).children(recursive=True)
        finally:
            training.kill()
    assert services
    try:
        assert psutil.wait_procs(services, timeout=30)[1] == []
    finally:
        for service in services:
            if service.is_running():
                service.kill()


@pytest.mark.slow
def test_one_that_does_not_start_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TIGAS_RENDER_SCENES", str(tmp_path / "nowhere"))
    with (
        pytest.raises(RenderFailed, match=r"^The render service did not start: .*nowhere"),
        render_service("cpu"),
    ):
        pass
