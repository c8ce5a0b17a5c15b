"""Labels stay few, however many scenes come and go."""

from __future__ import annotations

from tigas_common.metrics import MOST_SCENES, OTHER, SceneNames


def test_the_first_scenes_keep_their_names_and_the_rest_share_one() -> None:
    names = SceneNames()
    scenes = [f"scene {number}" for number in range(MOST_SCENES + 50)]
    first = [names.label(scene) for scene in scenes]
    assert first == [*scenes[:MOST_SCENES], *[OTHER] * 50]
    assert [names.label(scene) for scene in scenes] == first
