"""Training of a set of networks, one for each rung below the best, for one scene or for any scene."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import combinations

import numpy as np
import torch
from numpy.typing import NDArray

from tigas_common.weights import GENERAL, MAX_HEIGHT_RATIO, NetworkInfo, Weights, distance
from tigas_common.wire.render import Rung
from tigas_enhance.evaluate import psnr_gains
from tigas_enhance.network import describe_network, round_to_half, to_tensors
from tigas_enhance.pairs import NoTrainingData, Pair, ScenePairs
from tigas_enhance.renderer import Renderer
from tigas_enhance.train import Recipe, train

RENDERING_SHARE = 0.25
"""Maximum share of the time used to render views."""
MAX_NETWORKS = 3
"""Maximum number of networks for a ladder."""
HELD_OUT = {"cpu": 4, "cuda": 12}
"""Number of views on which gains are measured, by device."""
VIEWS = {"cpu": 64, "cuda": 256}
"""Number of training views of all scenes together, by device."""
RECIPES = {"cpu": Recipe(batch=8), "cuda": Recipe(batch=64)}

Listener = Callable[[str, float], None]
"""Progress callback with the current step and the completed share of all work, 0 to 1."""


def tune(
    renderer: Renderer,
    scene_ids: Sequence[str],
    seconds: float,
    device: torch.device,
    listener: Listener,
    *,
    general: bool = False,
) -> Weights:
    """Train weights for a scene or, if `general`, for any scene. Raises as Renderer does, and NoTrainingData."""
    began = time.monotonic()
    scenes = [renderer.load(scene_id) for scene_id in scene_ids]
    ladders = {renderer.ladder(scene) for scene in scenes}
    if len(ladders) > 1:
        raise NoTrainingData("The scenes have their own ladders: start the render service with --ladder paper.")
    ladder = ladders.pop()
    rungs = training_rungs(ladder)
    training: list[Pair] = []
    tests: list[list[Pair]] = []
    for index, scene in enumerate(scenes):
        listener(f"rendering views of {scene.id}", RENDERING_SHARE * index / len(scenes))
        pairs = ScenePairs(renderer, scene, ladder, rungs)
        until = began + seconds * RENDERING_SHARE * (index + 1) / len(scenes)
        training += pairs.training(max(1, VIEWS[device.type] // len(scenes)), until)
        tests.append(pairs.held_out(HELD_OUT[device.type]))
    networks: list[NetworkInfo] = []
    tensors: dict[str, NDArray[np.float16]] = {}
    for number, rung in enumerate(rungs):
        named, remaining = ladder[rung], began + seconds - time.monotonic()

        def report(done: float, number: int = number, named: Rung = named, rung: int = rung) -> None:
            whole = RENDERING_SHARE + (1 - RENDERING_SHARE) * (number + done) / len(rungs)
            listener(f"training rung {rung} ({named.width} × {named.height})", whole)

        share = max(remaining / (len(rungs) - number), 0.01)
        network = round_to_half(train(training, rung, RECIPES[device.type], share, device, report, augment=general))
        gain_db = float(np.mean([psnr_gains(pairs, rung, network, device).mean() for pairs in tests]))  # equal weights
        networks.append(describe_network(network, rung, named, gain_db))
        tensors |= to_tensors(rung, network)
    digest = GENERAL if general else scenes[0].file_sha256
    assert digest is not None, "known for every loaded scene"
    created = datetime.now(UTC).isoformat(timespec="seconds")
    return drop_useless_networks(Weights(digest, tuple(networks), tensors, created, version("tigas")))


def training_rungs(ladder: Sequence[Rung]) -> tuple[int, ...]:
    """The rungs below the best that get networks: all of a short ladder, else MAX_NETWORKS of them.

    They are chosen to serve the most rungs and, among these choices, the nearest ones. Raises NoTrainingData.
    """
    low = range(1, len(ladder))
    if not low:
        raise NoTrainingData("The ladder has only one rung, which needs no enhancement.")

    def coverage(chosen: tuple[int, ...]) -> tuple[int, float]:
        away = [min(distance(ladder[trained], ladder[rung])[0] for trained in chosen) for rung in low]
        served = [each for each in away if each <= math.log(MAX_HEIGHT_RATIO)]
        return len(served), -sum(served)

    return max(combinations(low, min(MAX_NETWORKS, len(low))), key=coverage)


def drop_useless_networks(weights: Weights) -> Weights:
    """Drop networks that do not improve held-out views. Raises NoTrainingData if none remains."""
    networks = tuple(network for network in weights.networks if (network.gain_db or 0) > 0)
    if not networks:
        raise NoTrainingData("The networks are no better than bicubic enlargement; give them more --seconds.")
    names = [name for network in networks for name in network.shapes]
    return replace(weights, networks=networks, tensors={name: weights.tensors[name] for name in names})
