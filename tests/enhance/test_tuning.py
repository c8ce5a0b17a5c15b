"""Checks of trained networks before they are written."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from tests.common.test_weights import NETWORK, made
from tigas_common.weights import parse_weights
from tigas_common.wire.render import DEFAULT_LADDER, Rung
from tigas_enhance.network import Network, rounded, to_network, to_tensors
from tigas_enhance.pairs import NothingToLearn
from tigas_enhance.tuning import gaining, training_rungs


def test_networks_that_make_nothing_better_are_left_out() -> None:
    worse = NETWORK.model_copy(update={"rung": 3, "gain_db": -0.1})
    kept = parse_weights(gaining(made(NETWORK, worse)).to_bytes())
    assert kept.networks == (NETWORK,)
    with pytest.raises(NothingToLearn, match="--seconds"):
        gaining(made(worse))


def test_a_network_is_the_same_after_it_was_written_and_read() -> None:
    torch.manual_seed(0)
    network = Network(NETWORK.scale, NETWORK.layers, NETWORK.channels)
    torch.nn.init.normal_(network.convolutions[-1].weight, std=0.1)  # type: ignore[arg-type]
    network = rounded(network)
    written = replace(made(NETWORK), tensors=to_tensors(NETWORK.rung, network))
    pictures = torch.rand(1, 3, 12, 16)
    assert torch.equal(to_network(NETWORK, parse_weights(written.to_bytes()))(pictures), network(pictures))


def test_of_many_rungs_those_are_trained_for_that_serve_the_most() -> None:
    def ladder(*heights: int) -> list[Rung]:
        return [Rung(name=f"{i}", width=640, height=h, quality=50, expected_kb=9) for i, h in enumerate(heights)]

    assert training_rungs(DEFAULT_LADDER) == (1, 2, 3)
    assert training_rungs(DEFAULT_LADDER[:2]) == (1,)
    assert training_rungs(ladder(720, 630, 540, 468, 300, 220, 200, 180, 144)) == (2, 4, 7)
    with pytest.raises(NothingToLearn, match="one rung only"):
        training_rungs(DEFAULT_LADDER[:1])
