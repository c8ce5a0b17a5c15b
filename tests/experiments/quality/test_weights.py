"""Trained weights: only the published file is kept and read, and no code in it runs."""

from __future__ import annotations

import hashlib
import http.server
import io
import os
import pickle
import threading
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tigas_common.errors import StartError
from tigas_experiments.quality import weights
from tigas_experiments.quality.perceptual import Dists, Lpips, Perceptual
from tigas_experiments.quality.sources import (
    ALEXNET,
    DISTS_WEIGHTS,
    FROM_TORCHVISION,
    LPIPS_HEADS,
    SOURCES,
    VGG16,
    Source,
    fetch,
)
from tigas_experiments.quality.weights import NoWeights, State

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
        ({"bytes": 100}, "has more than 100 bytes"),
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


@pytest.mark.parametrize("load", [weights.lpips, weights.dists])
def test_without_weights_the_command_that_gets_them_is_named(load: object) -> None:
    assert callable(load)
    with pytest.raises(NoWeights, match="not here: tigas quality fetch"):
        load()
    for source in SOURCES:
        source.cached.parent.mkdir(parents=True, exist_ok=True)
        source.cached.write_bytes(b"changed by somebody")
    with pytest.raises(NoWeights, match="differs from the published file: tigas quality fetch"):
        load()


def test_torchvisions_networks_do_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    torch.manual_seed(5)
    lpips, dists = Lpips(), Dists()
    heads = {f"lin{i}.model.1.weight": head.detach()[None, :, None, None] for i, head in enumerate(lpips.heads)}
    own = {name: getattr(dists, name).detach()[None, :, None, None] for name in ("alpha", "beta")}
    publish(monkeypatch, ALEXNET, torch_file(as_torchvision(lpips, (0, 3, 6, 8, 10))))
    publish(monkeypatch, LPIPS_HEADS, wheel("lpips/weights/v0.1/alex.pth", heads))
    publish(monkeypatch, VGG16, torch_file(as_torchvision(dists, (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28))))
    publish(monkeypatch, DISTS_WEIGHTS, wheel("DISTS_pytorch/weights.pt", own))
    for made, expected in ((weights.lpips(), lpips), (weights.dists(), dists)):
        found = made.state_dict()
        assert all(torch.equal(found[name], value) for name, value in expected.state_dict().items())
    assert {source.name for source in (ALEXNET, VGG16, LPIPS_HEADS, DISTS_WEIGHTS)} <= {
        source.name for source in FROM_TORCHVISION
    }


def as_torchvision(model: Perceptual, layers: Sequence[int]) -> State:
    """A network's convolutions under torchvision's names, with an unused layer."""
    found = {"classifier.0.weight": torch.zeros(1)}
    for layer, convolution in zip(layers, model.convolutions.children(), strict=True):
        found |= {f"features.{layer}.{name}": value for name, value in convolution.state_dict().items()}
    return found


def torch_file(state: State) -> bytes:
    """As PyTorch writes it."""
    buffer = io.BytesIO()
    torch.save(state, buffer)
    return buffer.getvalue()


def wheel(member: str, state: State) -> bytes:
    """A package with one file."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(member, torch_file(state))
    return buffer.getvalue()


def publish(monkeypatch: pytest.MonkeyPatch, source: Source, data: bytes) -> None:
    """As if a source had these bytes, and they were fetched."""
    name = next(name for name, value in vars(weights).items() if value is source)
    monkeypatch.setattr(weights, name, replace(source, sha256=hashlib.sha256(data).hexdigest(), bytes=len(data)))
    source.cached.parent.mkdir(parents=True, exist_ok=True)
    source.cached.write_bytes(data)


def test_a_pickle_holds_arrays_and_nothing_else() -> None:
    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.system, ("touch /tmp/never",)

    with pytest.raises(pickle.UnpicklingError, match="weights have no"):
        weights.Arrays(io.BytesIO(pickle.dumps({"a": Evil()}))).load()
    array = np.arange(6, dtype=np.float32).reshape(2, 3)
    as_published = pickle.dumps({"a": array}, 3).replace(b"numpy._core", b"numpy.core")
    assert np.array_equal(weights.Arrays(io.BytesIO(as_published)).load()["a"], array)
