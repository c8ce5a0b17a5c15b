"""Files of weights: written and read again, and one clear sentence for each way in which one can be wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy

from tigas_common.weights import (
    ARCHITECTURE,
    GENERAL,
    MAX_BYTES,
    BrokenWeights,
    NetworkInfo,
    Weights,
    parse_weights,
    read_weights,
)
from tigas_common.wire.render import DEFAULT_LADDER, Rung

NETWORK = NetworkInfo(rung=2, width=640, height=360, quality=35, scale=2, layers=3, channels=8, gain_db=1.25)


def made(*networks: NetworkInfo, scene: str = "ab" * 32) -> Weights:
    random = np.random.default_rng(0)
    shapes = {name: shape for network in networks for name, shape in network.shapes.items()}
    tensors = {name: random.standard_normal(shape).astype(np.float16) for name, shape in shapes.items()}
    return Weights(scene, networks, tensors, "2026-11-22T12:00:00Z", "0.2.0")


def changed(tensors: dict[str, Any] | None = None, **metadata: str | None) -> bytes:
    """A file in which some of these are otherwise."""
    whole = made(NETWORK)
    said = {
        "architecture": ARCHITECTURE,
        "scene_sha256": whole.scene_sha256,
        "networks": json.dumps([NETWORK.model_dump()]),
        "created": "",
        "version": "",
    } | metadata
    kept = {name: value for name, value in said.items() if value is not None}
    return safetensors.numpy.save({**whole.tensors, **(tensors or {})}, kept)


def test_what_was_written_is_read_again() -> None:
    first = NetworkInfo(rung=1, width=960, height=540, quality=65, scale=1, layers=5, channels=16)
    weights = made(first, NETWORK)
    again = parse_weights(weights.to_bytes())
    assert replace(again, tensors={}) == replace(weights, tensors={})
    for name, tensor in weights.tensors.items():
        assert np.array_equal(again.tensors[name], tensor)


NAN = {"rung2.conv1.bias": np.full(8, np.nan, np.float16)}
OTHER_SHAPE = {"rung2.conv1.weight": np.zeros((8, 8, 3, 1), np.float16)}
OTHER_TYPE = {"rung2.conv1.bias": np.zeros(8, np.float32)}
STRAY = {"rung3.conv0.bias": np.zeros(8, np.float16)}
TWICE = json.dumps([NETWORK.model_dump()] * 2)
HUGE = json.dumps([NETWORK.model_dump() | {"channels": 10**9}])


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "not a complete safetensors file"),
        (b"\xff" * 400, "not a complete safetensors file"),
        (changed()[:-1], "not a complete safetensors file"),
        (changed()[:100], "not a complete safetensors file"),
        (bytes(MAX_BYTES + 1), "more than 1,000,000 bytes"),
        (safetensors.numpy.save({"a": np.zeros(1, np.float16)}), "does not name its architecture"),
        (changed(architecture="other\n"), r"architecture 'other\\\\n'"),
        (changed(scene_sha256=None), "does not name its scene_sha256"),
        (changed(networks="[{}]"), "networks.0.rung"),
        (changed(networks="[]"), "at least one"),
        (changed(networks="["), "not valid"),
        (changed(networks=TWICE), "each only once"),
        (changed(networks=HUGE), "channels"),
        (changed(NAN), "rung2.conv1.bias are not all finite"),
        (changed(OTHER_SHAPE), r"lack rung2.conv1.weight as 16-bit floats of shape \[8, 8, 3, 3\]"),
        (changed(OTHER_TYPE), "lack rung2.conv1.bias"),
        (changed(STRAY), "belong to no network"),
    ],
    ids=lambda value: value if isinstance(value, str) else "content",
)
def test_what_is_wrong_is_said_in_a_sentence(content: bytes, sentence: str) -> None:
    with pytest.raises(BrokenWeights, match=sentence):
        parse_weights(content)


def test_only_a_regular_file_of_bounded_size_is_read(tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(bytes(MAX_BYTES + 1))
    for path in (tmp_path / "large", tmp_path, tmp_path / "missing"):
        with pytest.raises(OSError, match=path.name):
            read_weights(path)


def test_weights_fit_the_scene_that_they_were_trained_for_and_ladders_with_rungs_of_about_their_sizes() -> None:
    weights = made(NETWORK)
    assert weights.misfit(weights.scene_sha256, DEFAULT_LADDER) is None
    assert replace(weights, scene_sha256=GENERAL).misfit("cd" * 32, DEFAULT_LADDER) is None
    for other in ("cd" * 32, None):
        assert "changed since" in (weights.misfit(other, DEFAULT_LADDER) or "")
    assert weights.misfit(weights.scene_sha256, DEFAULT_LADDER[::-1]) is None
    assert "other frame sizes" in (weights.misfit(weights.scene_sha256, DEFAULT_LADDER[:2]) or "")


@pytest.mark.parametrize(
    ("height", "quality", "expected"),
    [
        (450, 35, (360, 35)),
        (451, 35, None),
        (288, 57, (360, 35)),
        (287, 35, None),
        (225, 90, (180, 10)),
        (360, 58, (360, 80)),
    ],
)
def test_a_rung_has_the_network_for_the_nearest_size_if_one_is_near(
    height: int, quality: int, expected: tuple[int, int] | None
) -> None:
    trained = ((360, 35), (360, 80), (180, 10))
    networks = tuple(NETWORK.model_copy(update={"height": h, "quality": q}) for h, q in trained)
    weights = replace(made(NETWORK), networks=networks)
    rung = Rung(name="", width=640, height=height, quality=quality, expected_kb=1)
    found = weights.network_for(rung)
    assert (found and (found.height, found.quality)) == expected
