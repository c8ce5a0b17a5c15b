"""Busy time adds up, whenever it is read."""

from __future__ import annotations

from tigas_render.engine.metrics import Utilisation


def test_time_at_rest_is_no_work_even_if_it_is_asked_for_meanwhile() -> None:
    renderer = Utilisation(0.0)
    assert renderer.read(1.0) == 1.0
    renderer.mark_idle(1.5)
    renderer.mark_idle(1.75)  # that goes on from its beginning
    assert [renderer.read(2.0), renderer.read(3.0)] == [0.5, 0.0]
    renderer.mark_busy(3.5)
    assert renderer.read(4.0) == 0.5
    renderer.mark_idle(4.25)
    renderer.mark_busy(4.5)
    renderer.mark_idle(4.75)
    assert [renderer.read(5.0), renderer.read(5.0)] == [0.5, 0.0]
