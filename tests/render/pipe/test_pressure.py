"""When an engine has as much to do as it can."""

from __future__ import annotations

from tigas_render.pipe.pressure import Pressure


def heard(pressure: Pressure, times: int, age_s: float, utilisation: float) -> bool:
    for _ in range(times):
        pressure.heard(age_s, utilisation)
    return pressure.pressed


def test_an_engine_that_hardly_rests_is_pressed_until_it_is_at_ease() -> None:
    pressure = Pressure()
    assert not heard(pressure, 50, 0.0, 0.8)
    assert heard(pressure, 20, 0.0, 0.95)
    assert heard(pressure, 50, 0.0, 0.75), "neither much nor little to do changes anything"
    assert not heard(pressure, 20, 0.0, 0.45)


def test_an_engine_whose_clients_wait_is_pressed_whatever_else_it_says() -> None:
    pressure = Pressure()
    assert heard(pressure, 20, 0.2, 0.3)
    assert not heard(pressure, 20, 0.0, 0.3)


def test_an_engine_says_when_it_may_soon_be_pressed_and_when_it_could_do_as_much_again() -> None:
    pressure = Pressure()
    for utilisation, is_near, at_ease in ((0.3, False, True), (0.5, False, False), (0.7, True, False)):
        heard(pressure, 50, 0.0, utilisation)
        assert (pressure.is_near, pressure.at_ease) == (is_near, at_ease)


def test_a_moment_is_no_pressure() -> None:
    pressure = Pressure()
    assert not heard(pressure, 2, 0.1, 1.0)
    assert not heard(pressure, 1, 0.0, 0.1)
