from __future__ import annotations

import pytest

from tigas_common.errors import StartError
from tigas_render.fleet.count import edges_for, suitable
from tigas_render.settings import RenderSettings


@pytest.mark.parametrize(
    ("cores", "gpu", "edges"),
    [(2, True, 1), (7, True, 1), (8, True, 2), (16, True, 4), (128, True, 8), (16, False, 1)],
)
def test_several_edges_are_for_machines_with_a_gpu_and_cores_to_spare(cores: int, gpu: bool, edges: int) -> None:
    assert suitable(cores, gpu) == edges


def test_what_is_set_is_taken_where_it_can_be(monkeypatch: pytest.MonkeyPatch) -> None:
    assert edges_for(RenderSettings(edges=3)) == 3
    assert edges_for(RenderSettings(edges="auto", device="cpu")) == 1  # type: ignore[arg-type]
    monkeypatch.setattr("sys.platform", "darwin")
    assert edges_for(RenderSettings(edges=1)) == 1
    with pytest.raises(StartError, match="Linux"):
        edges_for(RenderSettings(edges=2))


@pytest.mark.parametrize("given", ["0", "65", "-1", "two", "1.5"])
def test_other_numbers_of_edges_are_refused(given: str) -> None:
    with pytest.raises(ValueError, match="neither auto nor a number from 1 to 64"):
        RenderSettings(edges=given)  # type: ignore[arg-type]
