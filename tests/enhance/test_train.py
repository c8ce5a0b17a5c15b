"""A training of a few steps, on views that need no renderer."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import pytest
import torch

from tests.enhance.synthetic import pair
from tigas_enhance.evaluate import gains
from tigas_enhance.network import Network, resampled
from tigas_enhance.pairs import NothingToLearn
from tigas_enhance.train import Crops, Recipe, Variation, train

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
        varied=varied,
    )
    assert len(told) == STEPS
    assert told[-1] == 1
    assert gains([pair(seed) for seed in range(100, 104)], rung, network, CPU).min() > 0


@pytest.mark.slow
@pytest.mark.parametrize(("rung", "scale"), [(2, 2), (1, 2), (1, 1)])
def test_crops_lie_where_the_whole_picture_has_them(rung: int, scale: int) -> None:
    torch.manual_seed(0)
    pairs = [pair(0), pair(1)]
    recipe = Recipe(scale, layers=3, channels=8, batch=6)
    network = Network(scale, 3, 8)
    crops = Crops(pairs, rung, recipe, CPU)
    low, place, target = crops.draw()
    shown = place(network.inner(low))
    wholes = [torch.from_numpy(each.rungs[rung].copy()).permute(2, 0, 1)[None].float() / 255 for each in pairs]
    height, width = pairs[0].full.shape[:2]
    enlarged = [resampled(network(whole), width, height)[0] for whole in wholes]
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
    variations = [Variation.random(len(pictures), CPU) for _ in range(20)]
    for variation in variations:
        assert torch.equal(variation.turned_back(variation.turned(pictures)), pictures)
        coloured = variation.coloured(pictures)
        assert 0 <= coloured.min() < coloured.max() <= 1
        assert torch.allclose(variation.coloured(variation.turned(pictures)), variation.turned(coloured))
    assert len({tuple(variation.turned(pictures)[0, 0, 0, :6].tolist()) for variation in variations}) == 8


def test_a_rung_that_is_too_small_is_named() -> None:
    tiny = pair(0)
    tiny.rungs[2] = tiny.rungs[2][:12]
    with pytest.raises(NothingToLearn, match="12 pixels is too small"):
        train([tiny], 2, Recipe(batch=2), 1, CPU, lambda done: None)
