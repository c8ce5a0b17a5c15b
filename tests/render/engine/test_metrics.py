"""Busy time adds up, whenever it is read."""

from __future__ import annotations

from tigas_render.engine.metrics import Utilisation


def test_time_at_rest_is_no_work_even_if_it_is_asked_for_meanwhile() -> None:
    renderer = Utilisation(0.0)
    assert renderer.share(1.0) == 1.0
    renderer.rest(1.5)
    renderer.rest(1.75)  # that goes on from its beginning
    assert [renderer.share(2.0), renderer.share(3.0)] == [0.5, 0.0]
    renderer.work(3.5)
    assert renderer.share(4.0) == 0.5
    renderer.rest(4.25)
    renderer.work(4.5)
    renderer.rest(4.75)
    assert [renderer.share(5.0), renderer.share(5.0)] == [0.5, 0.0]
