"""The built-in scene: the very file that results speak of, with a view and a ladder that suit it.

Since its digest is pinned, nothing about its Gaussians can change unnoticed.
"""

from __future__ import annotations

import math
from itertools import pairwise

from tigas_render.scenes.demo import DEMO_SOURCE

SHA256 = "57659121169acb77cc344d37ca7825095773cbdfc89759e356124bc38f1382a8"


def test_it_is_the_courtyard_that_results_speak_of() -> None:
    assert DEMO_SOURCE.digest is not None
    assert DEMO_SOURCE.digest() == SHA256, "another scene needs another id: results name this one"
    assert (DEMO_SOURCE.id, DEMO_SOURCE.name, DEMO_SOURCE.format) == ("courtyard", "Courtyard", "SOG")
    scene = DEMO_SOURCE.load()
    assert len(scene) == DEMO_SOURCE.gaussians == 298_886
    assert scene.sh_degree == DEMO_SOURCE.sh_degree == 1


def test_it_comes_with_a_ladder_of_its_own_without_jumps() -> None:
    ladder = DEMO_SOURCE.ladder
    assert ladder is not None
    assert len(ladder) >= 8
    for better, worse in pairwise(ladder):
        assert 1.2 < better.expected_kb / worse.expected_kb < 2
        assert 1 < (better.psnr_db or 0) - (worse.psnr_db or 0) < 3
        assert worse.width * worse.height <= better.width * better.height


def test_a_visitor_enters_at_eye_height() -> None:
    camera = DEMO_SOURCE.metadata.camera
    assert camera is not None
    assert -2 < camera.position[1] < -1.5
    assert math.dist(camera.position, camera.look_at) > 1
