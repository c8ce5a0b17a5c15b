"""The network's shape, where it starts from, and how its picture gets to the size at which it is displayed."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from PIL import Image

from tigas_enhance.network import Network, enlarged, resampled, shown


@pytest.mark.parametrize("scale", [1, 2])
def test_an_untrained_network_enlarges_bilinearly(scale: int) -> None:
    pictures = torch.rand(2, 3, 9, 16)
    assert torch.equal(Network(scale, channels=8)(pictures), enlarged(pictures, scale))


def test_an_edge_is_replicated_before_every_convolution() -> None:
    torch.manual_seed(0)
    network = Network(1, channels=8)
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, std=0.1)
    colour = torch.tensor([0.2, 0.5, 0.7]).view(1, 3, 1, 1)
    outcome = network(colour.expand(1, 3, 12, 12))
    assert torch.allclose(outcome, outcome[..., :1, :1].expand_as(outcome), atol=1e-6)


@pytest.mark.parametrize("size", [(48, 36), (24, 20), (128, 72), (50, 31)])
def test_pictures_are_resampled_as_pillow_does_it(size: tuple[int, int]) -> None:
    random = np.random.default_rng(1).random((36, 48), dtype=np.float32)
    expected = np.asarray(Image.fromarray(random).resize(size, Image.Resampling.BICUBIC))
    outcome = resampled(torch.from_numpy(random)[None, None], *size)[0, 0]
    assert np.abs(outcome.numpy() - expected).max() < 1e-5


def test_an_enhanced_picture_has_the_size_and_values_of_a_display() -> None:
    network = Network(2, channels=8)
    torch.nn.init.normal_(network.convolutions[-1].weight, std=1.0)  # type: ignore[arg-type]
    picture = shown(network, torch.rand(1, 3, 18, 32), 48, 27)
    assert picture.shape == (1, 3, 27, 48)
    assert picture.min() >= 0
    assert picture.max() <= 1


@pytest.mark.parametrize("scale", [1, 2])
def test_what_is_learnt_on_crops_is_what_the_network_gives_inside(scale: int) -> None:
    torch.manual_seed(0)
    network = Network(scale, layers=4, channels=8)
    torch.nn.init.normal_(network.convolutions[-1].weight, std=0.02)  # type: ignore[arg-type]
    pictures = 0.4 + 0.2 * torch.rand(2, 3, 20, 24)
    whole, inner = network(pictures), network.inner(pictures)
    cut = 4 * scale
    assert torch.allclose(inner, whole[..., cut:-cut, cut:-cut], atol=1e-6)
