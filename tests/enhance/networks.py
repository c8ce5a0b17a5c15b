"""Networks with random weights, and their files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import safetensors.torch
import torch

from tigas_common.wire.render import DEFAULT_LADDER as LADDER
from tigas_common.wire.render import Rung
from tigas_enhance.network import Network

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
        network.load_state_dict({name: tensor.half().float() for name, tensor in network.state_dict().items()})
    return networks


def weights_file(
    networks: Mapping[int, Network], ladder: Sequence[Rung] = LADDER, scene_sha256: str = "general"
) -> bytes:
    """Their file, as if trained for that ladder and that scene."""
    described = [
        {
            **ladder[rung].model_dump(include={"width", "height", "quality"}),
            **{"rung": rung, "scale": network.scale, "layers": network.layers, "channels": network.channels},
        }
        for rung, network in networks.items()
    ]
    tensors = {
        f"rung{rung}.{name.replace('convolutions.', 'conv')}": tensor.half()
        for rung, network in networks.items()
        for name, tensor in network.state_dict().items()
    }
    metadata = {
        "architecture": "tigas-sr-1",
        "scene_sha256": scene_sha256,
        "networks": json.dumps(described),
        "created": "2026-11-22T12:00:00Z",
        "version": "0.2.0",
    }
    return safetensors.torch.save(tensors, metadata)
