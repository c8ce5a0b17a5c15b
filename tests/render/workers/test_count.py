"""How many edges suit a machine."""

from __future__ import annotations

import pytest

from tigas_common.errors import StartError
from tigas_render.settings import RenderSettings
from tigas_render.workers.devices import edges_for, suitable


@pytest.mark.parametrize(
    ("cores", "gpus", "edges"),
    [(2, 1, 1), (7, 1, 1), (8, 1, 3), (16, 1, 6), (128, 1, 8), (128, 2, 16), (32, 2, 12), (16, 0, 1)],
)
def test_several_edges_are_for_machines_with_a_gpu_and_cores_to_spare(cores: int, gpus: int, edges: int) -> None:
    assert suitable(cores, gpus > 0, max(1, gpus)) == edges


def test_what_is_set_is_taken_where_it_can_be(monkeypatch: pytest.MonkeyPatch) -> None:
    assert edges_for(RenderSettings(edges=3), 1) == 3
    assert edges_for(RenderSettings(edges="auto", device="cpu"), 1) == 1  # type: ignore[arg-type]
    monkeypatch.setattr("sys.platform", "darwin")
    assert edges_for(RenderSettings(edges=1), 1) == 1
    with pytest.raises(StartError, match="Linux"):
        edges_for(RenderSettings(edges=2), 1)


@pytest.mark.parametrize("given", ["0", "65", "-1", "two", "1.5"])
def test_other_numbers_of_edges_are_refused(given: str) -> None:
    with pytest.raises(ValueError, match="neither auto nor a number from 1 to 64"):
        RenderSettings(edges=given)  # type: ignore[arg-type]
