"""Networks with random weights, and their files."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from tigas_common.weights import GENERAL, Weights
from tigas_common.wire.render import DEFAULT_LADDER as LADDER
from tigas_enhance.network import Network, describe_network, round_to_half, to_tensors

__all__ = ["LADDER", "random_networks", "weights_file"]


def random_networks(
    scales: Mapping[int, int], layers: int = 5, channels: int = 16, seed: int = 0
) -> dict[int, Network]:
    """For each rung a network of that scale, which changes pictures by about a tenth of their range."""
    torch.manual_seed(seed)
    networks = {rung: Network(scale, layers, channels) for rung, scale in scales.items()}
    for network in networks.values():
        last = f"convolutions.{layers - 1}.weight"
        for name, parameter in network.named_parameters():
            if name.endswith(".bias"):
                torch.nn.init.normal_(parameter, std=0.05)
            elif name == last:
                torch.nn.init.normal_(parameter, std=0.2 / (9 * channels) ** 0.5)
    return {rung: round_to_half(network) for rung, network in networks.items()}


def weights_file(networks: Mapping[int, Network], scene_sha256: str = GENERAL) -> bytes:
    """Their file, as if trained for the default ladder and that scene."""
    infos = tuple(describe_network(network, rung, LADDER[rung], 1.0) for rung, network in networks.items())
    tensors = {name: each for rung, network in networks.items() for name, each in to_tensors(rung, network).items()}
    return Weights(scene_sha256, infos, tensors, "2026-11-22T12:00:00Z", "0.2.0").to_bytes()
