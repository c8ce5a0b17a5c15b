"""The network that enhances one rung: a small residual CNN (architecture `tigas-sr-1`)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from tigas_common.weights import NetworkInfo, Weights
from tigas_common.wire.render import Rung

NEGATIVE_SLOPE = 0.1
"""Slope of the leaky ReLU after every convolution but the last."""


class Network(nn.Module):
    """A network of `layers` 3×3 convolutions; the last one outputs the pixels of a picture `scale` times the size.

    Its output is added to the bilinearly enlarged input. Edges are replicated before each convolution.
    """

    def __init__(self, scale: int = 2, layers: int = 5, channels: int = 16) -> None:
        super().__init__()
        self.scale = scale
        self.layers = layers
        self.channels = channels
        widths = [3, *[channels] * (layers - 1), 3 * scale**2]
        convolutions = [nn.Conv2d(before, after, 3) for before, after in pairwise(widths)]
        for convolution in convolutions:
            nn.init.kaiming_normal_(convolution.weight, NEGATIVE_SLOPE, nonlinearity="leaky_relu")
            nn.init.zeros_(convolution.bias)  # type: ignore[arg-type]  # never None here
        nn.init.zeros_(convolutions[-1].weight)  # so that an untrained network enlarges bilinearly
        self.convolutions = nn.ModuleList(convolutions)

    def forward(self, pictures: Tensor) -> Tensor:
        """Enhance pictures [B, 3, H, W] of sRGB-coded values from 0 to 1; the result is `scale` times as large."""
        features = pictures
        for index in range(self.layers):
            features = self._convolve(index, functional.pad(features, (1, 1, 1, 1), mode="replicate"))
        return self._add_skip(features, pictures).clamp(0, 1)

    def forward_valid(self, pictures: Tensor) -> Tensor:
        """Output without the outermost `layers` pixels, so that it does not depend on the surroundings.

        Values are not clipped to 0 to 1, as clipping would stop gradients.
        """
        features = pictures
        for index in range(self.layers):
            features = self._convolve(index, features)
        return self._add_skip(features, pictures)

    def _convolve(self, index: int, features: Tensor) -> Tensor:
        outcome: Tensor = self.convolutions[index](features)
        return outcome if index == self.layers - 1 else functional.leaky_relu(outcome, NEGATIVE_SLOPE)

    def _add_skip(self, features: Tensor, pictures: Tensor) -> Tensor:
        residual = functional.pixel_shuffle(features, self.scale)
        cut = (pictures.shape[-1] * self.scale - residual.shape[-1]) // 2
        skip = upsample_bilinear(pictures, self.scale)
        return residual + (skip[..., cut:-cut, cut:-cut] if cut else skip)


def upsample_bilinear(pictures: Tensor, scale: int) -> Tensor:
    """Enlarge pictures [B, C, H, W] bilinearly by `scale`."""
    if scale == 1:
        return pictures
    return functional.interpolate(pictures, scale_factor=float(scale), mode="bilinear", align_corners=False)


def resample(pictures: Tensor, width: int, height: int) -> Tensor:
    """Resample pictures [B, C, H, W] with Catmull-Rom's bicubic filter, widened when reducing, as Pillow does."""
    if pictures.shape[-2:] == (height, width):
        return pictures
    return functional.interpolate(pictures, (height, width), mode="bicubic", align_corners=False, antialias=True)


def enhance(network: Network, pictures: Tensor, width: int, height: int) -> Tensor:
    """Enhance a rung's pictures [B, 3, H, W] and resample them to the size at which they are displayed."""
    enhanced = network(pictures)
    result: Tensor = torch.clamp(resample(enhanced, width, height), 0, 1)
    return result


def round_to_half(network: Network) -> Network:
    """The network with its weights rounded to 16-bit floats, as stored in a file."""
    return network.half().float()


def to_tensors(rung: int, network: Network) -> dict[str, NDArray[np.float16]]:
    """A network's weights, keyed by their names in a file."""
    return {
        _tensor_name(rung, name): value.detach().cpu().contiguous().half().numpy()
        for name, value in network.state_dict().items()
    }


def describe_network(network: Network, number: int, rung: Rung, gain_db: float) -> NetworkInfo:
    """Description of a rung's network for a file; gain_db: on held-out views."""
    return NetworkInfo(
        rung=number,
        width=rung.width,
        height=rung.height,
        quality=rung.quality,
        scale=2 if network.scale == 2 else 1,
        layers=network.layers,
        channels=network.channels,
        gain_db=round(gain_db, 3),
    )


def to_network(info: NetworkInfo, weights: Weights) -> Network:
    """Create a network from a file's weights."""
    network = Network(info.scale, info.layers, info.channels)
    state = {
        name: torch.from_numpy(weights.tensors[_tensor_name(info.rung, name)].astype(np.float32))
        for name in network.state_dict()
    }
    network.load_state_dict(state)
    return network


def _tensor_name(rung: int, name: str) -> str:
    return f"rung{rung}.{name.replace('convolutions.', 'conv')}"
