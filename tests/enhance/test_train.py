"""Training of networks, and the choice of which are kept."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import numpy as np
import pytest
import torch
from PIL import Image

from tests.common.test_weights import NETWORK, made
from tests.enhance.networks import random_networks, weights_file
from tests.enhance.synthetic import pair
from tigas_common.weights import parse_weights
from tigas_common.wire.render import DEFAULT_LADDER, Rung
from tigas_enhance.evaluate import psnr_gains
from tigas_enhance.network import Network, enhance, resample, to_network, upsample_bilinear
from tigas_enhance.pairs import NoTrainingData
from tigas_enhance.train import Augmentation, Crops, Recipe, train
from tigas_enhance.tuning import drop_useless_networks, training_rungs

CPU = torch.device("cpu")
STEPS = 60


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Small pictures are not worth more, least of all on a machine that is busy."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.mark.slow
@pytest.mark.parametrize("varied", [False, True])
@pytest.mark.parametrize(("rung", "scale"), [(2, 2), (1, 1)])
def test_a_few_steps_beat_bicubic_enlargement(rung: int, scale: int, varied: bool) -> None:
    ticks, told = count(), list[float]()
    network = train(
        [pair(seed) for seed in range(6)],
        rung,
        Recipe(scale, layers=3, channels=12, batch=8),
        STEPS,
        CPU,
        told.append,
        clock=lambda: float(next(ticks)),
        augment=varied,
    )
    assert len(told) == STEPS
    assert told[-1] == 1
    assert psnr_gains([pair(seed) for seed in range(100, 104)], rung, network, CPU).min() > 0


@pytest.mark.slow
@pytest.mark.parametrize(("rung", "scale"), [(2, 2), (1, 2), (1, 1)])
def test_crops_lie_where_the_whole_picture_has_them(rung: int, scale: int) -> None:
    torch.manual_seed(0)
    pairs = [pair(0), pair(1)]
    recipe = Recipe(scale, layers=3, channels=8, batch=6)
    network = Network(scale, 3, 8)
    crops = Crops(pairs, rung, recipe, CPU)
    low, place, target = crops.sample()
    shown = place(network.forward_valid(low))
    wholes = [torch.from_numpy(each.rungs[rung].copy()).permute(2, 0, 1)[None].float() / 255 for each in pairs]
    height, width = pairs[0].full.shape[:2]
    enlarged = [resample(network(whole), width, height)[0] for whole in wholes]
    truths = [torch.from_numpy(each.full).permute(2, 0, 1).float() / 255 for each in pairs]
    for crop, truth in zip(shown, target, strict=True):
        assert any(_found(crop, truth, a, b) for a, b in zip(enlarged, truths, strict=True))


def _found(crop: torch.Tensor, truth: torch.Tensor, enlarged: torch.Tensor, whole: torch.Tensor) -> bool:
    """Whether the crop and its target match at some position of a whole picture."""
    _, h, w = crop.shape
    windows = whole.unfold(1, h, 1).unfold(2, w, 1)  # [3, y, x, h, w]
    places = (windows == truth[:, None, None]).all(dim=4).all(dim=3).all(dim=0).nonzero().tolist()
    return any(torch.allclose(enlarged[:, y : y + h, x : x + w], crop, atol=1e-4) for y, x in places)


def test_varied_pictures_are_the_same_picture_in_another_way() -> None:
    torch.manual_seed(0)
    pictures = torch.rand(4, 3, 8, 6)
    variations = [Augmentation.random(len(pictures), CPU) for _ in range(20)]
    for variation in variations:
        assert torch.equal(variation.unflip(variation.flip(pictures)), pictures)
        coloured = variation.jitter_colours(pictures)
        assert 0 <= coloured.min() < coloured.max() <= 1
        assert torch.allclose(variation.jitter_colours(variation.flip(pictures)), variation.flip(coloured))
    assert len({tuple(variation.flip(pictures)[0, 0, 0, :6].tolist()) for variation in variations}) == 8


def test_a_rung_that_is_too_small_is_named() -> None:
    tiny = pair(0)
    tiny.rungs[2] = tiny.rungs[2][:12]
    with pytest.raises(NoTrainingData, match="12 pixels is too small"):
        train([tiny], 2, Recipe(batch=2), 1, CPU, lambda done: None)


def test_networks_that_make_nothing_better_are_left_out() -> None:
    worse = NETWORK.model_copy(update={"rung": 3, "gain_db": -0.1})
    kept = parse_weights(drop_useless_networks(made(NETWORK, worse)).to_bytes())
    assert kept.networks == (NETWORK,)
    with pytest.raises(NoTrainingData, match="--seconds"):
        drop_useless_networks(made(worse))


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
    with pytest.raises(NoTrainingData, match="only one rung"):
        training_rungs(named[:1])


@pytest.mark.parametrize("scale", [1, 2])
def test_an_untrained_network_enlarges_bilinearly(scale: int) -> None:
    pictures = torch.rand(2, 3, 9, 16)
    assert torch.equal(Network(scale, channels=8)(pictures), upsample_bilinear(pictures, scale))


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
    outcome = resample(torch.from_numpy(random)[None, None], *size)[0, 0]
    assert np.abs(outcome.numpy() - expected).max() < 1e-5


def test_an_enhanced_picture_has_the_size_and_values_of_a_display() -> None:
    network = Network(2, channels=8)
    torch.nn.init.normal_(network.convolutions[-1].weight, std=1.0)  # type: ignore[arg-type]
    picture = enhance(network, torch.rand(1, 3, 18, 32), 48, 27)
    assert picture.shape == (1, 3, 27, 48)
    assert picture.min() >= 0
    assert picture.max() <= 1


@pytest.mark.parametrize("scale", [1, 2])
def test_what_is_learnt_on_crops_is_what_the_network_gives_inside(scale: int) -> None:
    torch.manual_seed(0)
    network = Network(scale, layers=4, channels=8)
    torch.nn.init.normal_(network.convolutions[-1].weight, std=0.02)  # type: ignore[arg-type]
    pictures = 0.4 + 0.2 * torch.rand(2, 3, 20, 24)
    whole, inner = network(pictures), network.forward_valid(pictures)
    cut = 4 * scale
    assert torch.allclose(inner, whole[..., cut:-cut, cut:-cut], atol=1e-6)
