"""Tests of which places serve a scene."""

from __future__ import annotations

import pytest

from tigas_common import placement
from tigas_common.placement import NARROW_S, WIDEN_S, Candidate, Placement, rank_names

NAMES = ("a", "b", "c", "d")
SCENES = [f"scene {number}" for number in range(400)]


class Placed(Placement):
    """With a clock that stands still until it is moved."""

    def __init__(self) -> None:
        self.now = 1000.0
        super().__init__(lambda: self.now)

    def asked(self, seconds: float, places: list[Candidate]) -> list[str]:
        """Places of a scene requested ten times per second, after this time."""
        for _ in range(round(10 * seconds)):
            self.places("garden", places)
            self.now += 0.1
        return self.places("garden", places)


@pytest.fixture
def placed() -> Placed:
    return Placed()


def up(*pressed: str, names: tuple[str, ...] = NAMES) -> list[Candidate]:
    return [Candidate(name, name in pressed) for name in names]


def test_nothing_is_placed_where_nothing_is_up() -> None:
    assert Placed().places("garden", []) == []


def test_all_who_decide_agree() -> None:
    one, other = Placed(), Placed()
    for scene in SCENES:
        assert one.places(scene, up()) == other.places(scene, up()[::-1])


def test_the_order_is_the_same_in_every_version() -> None:
    assert rank_names("garden", NAMES) == rank_names("garden", NAMES[::-1]) == ("a", "c", "d", "b")


def test_places_get_about_as_many_scenes_each(placed: Placed) -> None:
    shares = [sum(placed.places(scene, up()) == [name] for scene in SCENES) for name in NAMES]
    assert sum(shares) == len(SCENES)
    assert min(shares) > len(SCENES) / len(NAMES) / 2


def test_a_place_that_goes_moves_only_its_own_scenes(placed: Placed) -> None:
    for scene in SCENES:
        before = placed.places(scene, up())
        after = placed.places(scene, up(names=("a", "b", "d")))
        assert after == before or before == ["c"]


def test_a_scene_whose_place_is_pressed_long_enough_gets_another(placed: Placed) -> None:
    first, second, third, _ = rank_names("garden", NAMES)
    assert placed.asked(WIDEN_S - 0.2, up(first)) == [first]
    assert placed.asked(0.3, up(first)) == [first, second]
    assert placed.asked(10, up(first)) == [first, second], "the second has room"
    assert placed.asked(WIDEN_S + 0.1, up(first, second)) == [first, second, third]


def test_other_scenes_stay_where_they_are(placed: Placed) -> None:
    first = rank_names("garden", NAMES)[0]
    elsewhere = next(scene for scene in SCENES if rank_names(scene, NAMES)[0] != first)
    placed.asked(5, up(first))
    assert placed.places(elsewhere, up(first)) == [rank_names(elsewhere, NAMES)[0]]


def test_a_moment_of_pressure_widens_nothing(placed: Placed) -> None:
    first = rank_names("garden", NAMES)[0]
    for _ in range(20):
        placed.asked(WIDEN_S / 2, up(first))
        assert placed.asked(0.1, up()) == [first]


def test_pressure_before_a_pause_does_not_count(placed: Placed) -> None:
    first = rank_names("garden", NAMES)[0]
    placed.places("garden", up(first))
    placed.now += 3600
    assert placed.places("garden", up(first)) == [first]


def test_a_scene_never_has_more_places_than_there_are(placed: Placed) -> None:
    assert len(placed.asked(20, up(*NAMES))) == len(NAMES)
    assert placed.asked(20, up("a", names=("a",))) == ["a"]


def test_a_scene_is_narrow_again_after_a_calm_while(placed: Placed) -> None:
    first, second, *_ = rank_names("garden", NAMES)
    placed.asked(WIDEN_S + 0.2, up(first))
    assert placed.asked(NARROW_S - 1, up()) == [first, second]
    assert placed.asked(2, up()) == [first]


def test_a_scene_that_nobody_asked_for_is_narrow_again(placed: Placed) -> None:
    first = rank_names("garden", NAMES)[0]
    placed.asked(WIDEN_S + 0.2, up(first))
    placed.now += NARROW_S + 1
    assert placed.places("garden", up()) == [first]


def test_a_scene_that_needs_two_places_does_not_lose_one_again_and_again(placed: Placed) -> None:
    first = rank_names("garden", NAMES)[0]
    narrowed = 0
    before = [first]
    for _ in range(3600 * 2):  # an hour in which one place does not suffice, but two are at ease
        now = placed.places("garden", up(first) if before == [first] else up())
        narrowed += len(now) < len(before)
        before = now
        placed.now += 0.5
    assert 0 < narrowed < 15, "with the same patience each time it would be about 115"


def test_a_scene_keeps_its_places_while_fewer_could_not_do_as_much(placed: Placed) -> None:
    first, second, *_ = rank_names("garden", NAMES)
    placed.asked(WIDEN_S + 0.2, up(first))
    half_busy = [Candidate(name, has_headroom=False) for name in NAMES]
    assert placed.asked(10 * NARROW_S, half_busy) == [first, second]
    assert placed.asked(NARROW_S + 1, up()) == [first]


def test_scenes_that_nobody_has_do_not_fill_the_memory(placed: Placed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(placement, "MOST_SCENES", 10)
    for scene in SCENES:
        placed.places(scene, up(*NAMES))
    first = rank_names("garden", NAMES)[0]
    assert len(placed.asked(WIDEN_S + 0.2, up(first))) == 2, "a scene that is asked for is remembered"
    assert len(placed._widths) <= 10
