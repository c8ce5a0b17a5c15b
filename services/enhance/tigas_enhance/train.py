"""Training of networks on pairs for a given time: Adam with a cosine schedule, L1 at display size, on random crops."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tigas_enhance.network import Network, resample
from tigas_enhance.pairs import NoTrainingData, Pair

LEARNING_RATE = 4e-3
BETAS = (0.9, 0.99)
"""Adam's decay rates, the second lower than usual, as a training on a CPU has few steps."""
WARM_UP_STEPS = 10
"""Number of steps during which the learning rate rises."""
MAX_CROP = 64
"""Maximum side length of a crop, in pixels of the rung."""
CANDIDATES = 4
"""Number of places tried for each crop until one is not background."""
MIN_STEPS = 60
"""Minimum number of steps: a slow machine exceeds the given time rather than make fewer."""

Report = Callable[[float], None]
"""Progress callback with the completed share of a training, 0 to 1."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """Shape of a network, and the number of crops per step."""

    scale: int = 2
    layers: int = 5
    channels: int = 16
    batch: int = 64


def train(
    pairs: Sequence[Pair],
    rung: int,
    recipe: Recipe,
    seconds: float,
    device: torch.device,
    report: Report,
    clock: Callable[[], float] = time.monotonic,
    *,
    augment: bool = False,
) -> Network:
    """Train a network for one rung, with at least MIN_STEPS steps; it is returned on the CPU. Raises NoTrainingData.

    varied: whether to vary colours, and flip and transpose, so that the network generalises to new scenes.
    """
    torch.manual_seed(0)
    crops = Crops(pairs, rung, recipe, device)
    network = Network(recipe.scale, recipe.layers, recipe.channels).to(device)
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # missing in PyTorch's signature
    optimiser = torch.optim.Adam(network.parameters(), LEARNING_RATE, BETAS, fused=device.type == "cuda")
    began, step, done = clock(), 0, 0.0
    while done < 1:
        for group in optimiser.param_groups:
            rising = min(1, (step + 1) / WARM_UP_STEPS)
            group["lr"] = LEARNING_RATE * rising * (1 + math.cos(math.pi * done)) / 2
        low, place, target = crops.sample()
        variation = Augmentation.random(len(low), device) if augment else Augmentation()
        with torch.autocast(device.type, torch.bfloat16, enabled=device.type == "cuda"):
            outcome = network.forward_valid(variation.flip(variation.jitter_colours(low)))
        loss = (place(variation.unflip(outcome).float()) - variation.jitter_colours(target)).abs().mean()
        optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        step += 1
        if device.type == "cpu" or step % 20 == 0:  # makes the processor wait for a GPU occasionally
            loss.item()
            done = min(step / MIN_STEPS, (clock() - began) / seconds, 1)
            report(done)
    return network.cpu()


@dataclass(frozen=True, slots=True)
class Augmentation:
    """An augmentation that does not affect the learnt mapping; the identity by default."""

    colours: tuple[Tensor, Tensor, Tensor] | None = None
    """Source of each channel [3], and contrast and brightness of each picture [B, 1, 1, 1]."""
    flips: tuple[int, ...] = ()
    """Dimensions to flip."""
    transposed: bool = False

    @classmethod
    def random(cls, pictures: int, device: torch.device) -> Augmentation:
        contrast = 0.5 + 0.5 * torch.rand(pictures, 1, 1, 1, device=device)
        brightness = (1 - contrast) * torch.rand(pictures, 1, 1, 1, device=device)
        flips = tuple(dimension for dimension in (-1, -2) if torch.rand(()) < 0.5)
        return cls((torch.randperm(3, device=device), contrast, brightness), flips, bool(torch.rand(()) < 0.5))

    def jitter_colours(self, pictures: Tensor) -> Tensor:
        """Change the colours of pictures [B, 3, H, W] of values from 0 to 1."""
        if self.colours is None:
            return pictures
        channels, contrast, brightness = self.colours
        return pictures[:, channels] * contrast + brightness

    def flip(self, pictures: Tensor) -> Tensor:
        """Flip and then transpose pictures [B, 3, H, W]."""
        flipped = pictures.flip(self.flips)
        return flipped.mT if self.transposed else flipped

    def unflip(self, pictures: Tensor) -> Tensor:
        """The inverse of `flip`."""
        return (pictures.mT if self.transposed else pictures).flip(self.flips)


class Crops:
    """Random crops of a rung's frames, and their targets at display size."""

    def __init__(self, pairs: Sequence[Pair], rung: int, recipe: Recipe, device: torch.device) -> None:
        self._low = _stack([pair.rungs[rung] for pair in pairs], device)  # [N, h, w, 3]
        self._full = _stack([pair.full for pair in pairs], device)  # [N, H, W, 3]
        self._content = _stack([pair.content for pair in pairs], device)  # [N, H, W]
        self._batch, self._scale, self._device = recipe.batch, recipe.scale, device
        self._rows = _Axis.create(self._low.shape[1], self._full.shape[1], recipe, device)
        self._columns = _Axis.create(self._low.shape[2], self._full.shape[2], recipe, device)

    def sample(self) -> tuple[Tensor, Callable[[Tensor], Tensor], Tensor]:
        """Crops [B, 3, c, c], the resampling of network outputs to display size, and targets [B, 3, d, d].

        At display size, a crop excludes the margin that depends on its surroundings.
        """
        view, y, x = self._choose_places()
        low = _gather(self._low, view, _window(y, self._rows.crop), _window(x, self._columns.crop))
        top, left = self._rows.target_start(y), self._columns.target_start(x)
        full = _gather(self._full, view, _window(top, self._rows.target_size), _window(left, self._columns.target_size))
        vertical, horizontal = self._rows.weights(y), self._columns.weights(x)

        def place(pictures: Tensor) -> Tensor:
            return torch.einsum("bij,bcjk,blk->bcil", vertical, pictures, horizontal)

        return low, place, full

    def _choose_places(self) -> tuple[Tensor, Tensor, Tensor]:
        """Views, first rows and first columns [B]: of several candidates, the first that is not background."""
        shape = (CANDIDATES, self._batch)
        views = self._random(len(self._low), shape)
        ys, xs = self._random(self._rows.place_count, shape), self._random(self._columns.place_count, shape)
        shows = self._content[views, self._rows.middle(ys), self._columns.middle(xs)]
        chosen = shows.to(torch.uint8).argmax(0, keepdim=True)
        view, y, x = (each.gather(0, chosen)[0] for each in (views, ys, xs))
        return view, y, x

    def _random(self, below: int, shape: tuple[int, int]) -> Tensor:
        return torch.randint(below, shape, device=self._device)


@dataclass(frozen=True, slots=True)
class _Axis:
    """Resampling from crop to display pixels, for rows or columns. `place` is the first pixel of a crop."""

    size: int
    """Size of the rung in pixels."""
    crop: int
    inner: int
    """Pixels on each side of a crop that a network reads but does not output."""
    margin: int
    """Ignored margin on each side: those pixels, and the support of the resampling."""
    scale: int
    ratio: float
    """Display pixels per pixel of the rung."""
    matrix: Tensor
    """[display, scale · size] resampling of a whole line."""

    @classmethod
    def create(cls, size: int, display: int, recipe: Recipe, device: torch.device) -> _Axis:
        enlarged = recipe.scale * size
        margin = recipe.layers + math.ceil(2 * max(1, enlarged / display) / recipe.scale)
        crop = min(MAX_CROP, size)
        if crop < 2 * margin + 8:
            raise NoTrainingData(f"A rung of {size} pixels is too small to learn from.")
        line = torch.eye(enlarged, device=device)[None, :, None]
        matrix = resample(line, display, 1)[0, :, 0].T.contiguous()
        return cls(size, crop, recipe.layers, margin, recipe.scale, display / size, matrix)

    @property
    def place_count(self) -> int:
        return self.size - self.crop + 1

    @property
    def target_size(self) -> int:
        return math.floor((self.crop - 2 * self.margin) * self.ratio) - 1

    def middle(self, place: Tensor) -> Tensor:
        return ((place + self.crop / 2) * self.ratio).long()

    def target_start(self, place: Tensor) -> Tensor:
        return ((place + self.margin) * self.ratio).ceil().long()

    def weights(self, place: Tensor) -> Tensor:
        """[B, shown, scale · (crop − 2 · inner)] Resampling of network outputs of crops."""
        source = _window(self.scale * (place + self.inner), self.scale * (self.crop - 2 * self.inner))
        return self.matrix[_window(self.target_start(place), self.target_size)[:, :, None], source[:, None]]


def _window(start: Tensor, length: int) -> Tensor:
    """[B, length] indices."""
    return start[:, None] + torch.arange(length, device=start.device)


def _stack(arrays: Sequence[np.ndarray[tuple[int, ...], np.dtype[np.generic]]], device: torch.device) -> Tensor:
    return torch.from_numpy(np.stack(arrays)).to(device)


def _gather(pixels: Tensor, view: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """[B, 3, h, w] from 0 to 1, of bytes [N, H, W, 3], views [B], rows [B, h] and columns [B, w]."""
    return pixels[view[:, None, None], rows[:, :, None], columns[:, None]].permute(0, 3, 1, 2).float() / 255
