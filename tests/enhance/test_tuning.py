"""Checks of trained networks before they are written."""

from __future__ import annotations

import pytest
import torch

from tests.common.test_weights import NETWORK, made
from tests.enhance.networks import random_networks, weights_file
from tigas_common.weights import parse_weights
from tigas_common.wire.render import DEFAULT_LADDER, Rung
from tigas_enhance.network import to_network
from tigas_enhance.pairs import NothingToLearn
from tigas_enhance.tuning import gaining, training_rungs


def test_networks_that_make_nothing_better_are_left_out() -> None:
    worse = NETWORK.model_copy(update={"rung": 3, "gain_db": -0.1})
    kept = parse_weights(gaining(made(NETWORK, worse)).to_bytes())
    assert kept.networks == (NETWORK,)
    with pytest.raises(NothingToLearn, match="--seconds"):
        gaining(made(worse))


def test_a_network_is_the_same_after_it_was_written_and_read() -> None:
    networks = random_networks({1: 1, 3: 2}, layers=3, channels=8)
    read = parse_weights(weights_file(networks))
    pictures = torch.rand(1, 3, 12, 16)
    for info in read.networks:
        assert torch.equal(to_network(info, read)(pictures), networks[info.rung](pictures))


@pytest.mark.parametrize(
    ("heights", "rungs"), [((720, 630, 540, 468, 300, 220, 200, 180, 144), (2, 4, 7)), ((720, 540), (1,))]
)
def test_rungs_that_serve_the_most_are_trained(heights: tuple[int, ...], rungs: tuple[int, ...]) -> None:
    assert training_rungs(DEFAULT_LADDER) == (1, 2, 3)
    named = [Rung(name=f"{i}", width=640, height=h, quality=50, expected_kb=9) for i, h in enumerate(heights)]
    assert training_rungs(named) == rungs
    with pytest.raises(NothingToLearn, match="one rung only"):
        training_rungs(named[:1])
