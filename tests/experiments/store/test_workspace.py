"""The folder of incomplete data: one store at a time, in a usable folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.web.server import Store
from tigas_common.errors import StartError
from tigas_experiments.store.workspace import Workspace


def test_a_second_store_of_the_same_results_is_refused(tmp_path: Path) -> None:
    with Workspace.opened(tmp_path):
        with pytest.raises(StartError, match="Another store keeps its results"), Workspace.opened(tmp_path):
            pass
        with pytest.raises(AssertionError, match="Another store keeps its results"), Store("--results", str(tmp_path)):
            pass
    with Workspace.opened(tmp_path):
        pass


def test_a_results_path_that_is_no_folder_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StartError, match="Results cannot be kept in"), Workspace.opened(tmp_path / "file"):
        pass
