"""Trains a set of networks, one for each rung below the best: for one scene, or for any from several."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import combinations, islice

import numpy as np
import torch
from numpy.typing import NDArray

from tigas_common.weights import GENERAL, NEAR, NetworkInfo, Weights, distance
from tigas_common.wire.render import Rung, SceneInfo
from tigas_enhance.errors import NothingToLearn
from tigas_enhance.evaluate import bicubic_scores, enhanced_scores
from tigas_enhance.network import Network
from tigas_enhance.pairs import Pair, Renderer, several
from tigas_enhance.train import Recipe, train
from tigas_enhance.views import held_out_views, training_views

RENDERING = 0.25
"""The share of the time in which views are rendered, at most."""
NETWORKS = 3
"""Maximum number of networks for a ladder."""
TRIES = 4
"""Maximum number of poses tried for a view that shows something."""
HELD_OUT = {"cpu": 4, "cuda": 12}
"""Views that a training's gains are measured on."""
VIEWS = {"cpu": 64, "cuda": 256}
"""Training views of all scenes together, by device."""
RECIPES = {"cpu": Recipe(batch=8), "cuda": Recipe(batch=64)}

Listener = Callable[[str, float], None]
"""Progress callback with the current step and the completed share of all work, 0 to 1."""


@dataclass(frozen=True, slots=True)
class SceneViews:
    """Training and test views of a scene."""

    scene: SceneInfo
    training: list[Pair]
    held_out: list[Pair]

    @property
    def digest(self) -> str:
        """Digest of the scene's file, which its weights belong to."""
        assert self.scene.file_sha256 is not None, "the service tells it of every scene that it has loaded"
        return self.scene.file_sha256


def collect(
    renderer: Renderer, scene: SceneInfo, ladder: Sequence[Rung], number: int, held_out: int, until: float
) -> SceneViews:
    """Up to `count` views of a scene, or as many as are rendered until a time of the monotonic clock.

    Raises RenderFailed and NothingToLearn.
    """
    rungs = training_rungs(ladder)
    training = renderer.pairs(scene, ladder, rungs, islice(training_views(scene), TRIES * number))
    tests = held_out_pairs(renderer, scene, ladder, rungs, held_out)
    return SceneViews(scene, several(training, number, until), tests)


def held_out_pairs(
    renderer: Renderer, scene: SceneInfo, ladder: Sequence[Rung], rungs: Sequence[int], number: int
) -> list[Pair]:
    """The views of a scene that no training sees. Raises RenderFailed and NothingToLearn."""
    return several(renderer.pairs(scene, ladder, rungs, held_out_views(scene, TRIES * number)), number)


def training_rungs(ladder: Sequence[Rung]) -> tuple[int, ...]:
    """The rungs below the best with networks of their own: all of a short ladder, else NETWORKS of them.

    Chosen to serve the most rungs, then the nearest ones. Raises NothingToLearn.
    """
    low = range(1, len(ladder))
    if not low:
        raise NothingToLearn("The ladder has one rung only, and that needs no enhancement.")

    def worth(chosen: tuple[int, ...]) -> tuple[int, float]:
        away = [min(distance(ladder[trained], ladder[rung])[0] for trained in chosen) for rung in low]
        served = [each for each in away if each <= math.log(NEAR)]
        return len(served), -sum(served)

    return max(combinations(low, min(NETWORKS, len(low))), key=worth)


def common_ladder(renderer: Renderer, scenes: Sequence[SceneInfo]) -> tuple[Rung, ...]:
    """The ladder of all of several scenes. Raises NothingToLearn if they differ."""
    ladders = {renderer.ladder(scene) for scene in scenes}
    if len(ladders) > 1:
        raise NothingToLearn("The scenes have their own ladders: start the render service with --ladder paper.")
    return ladders.pop()


def tune(
    renderer: Renderer,
    scene_ids: Sequence[str],
    seconds: float,
    device: torch.device,
    listener: Listener,
    *,
    general: bool = False,
) -> Weights:
    """Weights for the scene, or, if they are `general`, for any scene. Raises RenderFailed and NothingToLearn."""
    began = time.monotonic()
    scenes = [renderer.load(scene_id) for scene_id in scene_ids]
    ladder = common_ladder(renderer, scenes)
    found = []
    for index, scene in enumerate(scenes):
        listener(f"rendering views of {scene.id}", RENDERING * index / len(scenes))
        until = began + seconds * RENDERING * (index + 1) / len(scenes)
        number = max(1, VIEWS[device.type] // len(scenes))
        found.append(collect(renderer, scene, ladder, number, HELD_OUT[device.type], until))
    return gaining(fit(found, ladder, began + seconds, device, listener, general=general))


def fit(
    scenes: Sequence[SceneViews],
    ladder: Sequence[Rung],
    until: float,
    device: torch.device,
    listener: Listener,
    recipe: Recipe | None = None,
    *,
    general: bool = False,
) -> Weights:
    """Weights from views that are there, at a time of the monotonic clock."""
    rungs = training_rungs(ladder)
    training = [pair for scene in scenes for pair in scene.training]
    networks: list[NetworkInfo] = []
    tensors: dict[str, NDArray[np.float16]] = {}
    for rung in rungs:
        share = (until - time.monotonic()) / (len(rungs) - len(networks))

        def report(done: float, rung: int = rung) -> None:
            whole = RENDERING + (1 - RENDERING) * (rungs.index(rung) + done) / len(rungs)
            listener(f"training rung {rung} ({ladder[rung].width} × {ladder[rung].height})", whole)

        chosen = recipe or RECIPES[device.type]
        network = rounded(train(training, rung, chosen, max(share, 0.01), device, report, varied=general))
        named = ladder[rung]
        info = NetworkInfo(
            rung=rung,
            width=named.width,
            height=named.height,
            quality=named.quality,
            scale=2 if network.scale == 2 else 1,
            layers=network.layers,
            channels=network.channels,
            gain_db=round(float(np.mean([gains(scene.held_out, rung, network, device) for scene in scenes])), 3),
        )
        networks.append(info)
        tensors |= to_tensors(rung, network)
    digest = GENERAL if general else scenes[0].digest
    created = datetime.now(UTC).isoformat(timespec="seconds")
    return Weights(digest, tuple(networks), tensors, created, version("tigas"))


def gaining(weights: Weights) -> Weights:
    """Without the networks that make held-out views no better. Raises NothingToLearn if none is left."""
    networks = tuple(network for network in weights.networks if (network.gain_db or 0) > 0)
    if not networks:
        raise NothingToLearn("The networks make no view better than bicubic enlargement; give them more --seconds.")
    names = [name for network in networks for name in network.shapes]
    return replace(weights, networks=networks, tensors={name: weights.tensors[name] for name in names})


def gains(pairs: Sequence[Pair], rung: int, network: Network, device: torch.device) -> NDArray[np.float64]:
    """PSNR over bicubic enlargement, in dB, of each view [N]."""
    return enhanced_scores(pairs, rung, network, device).psnr - bicubic_scores(pairs, rung, device).psnr


def rounded(network: Network) -> Network:
    """The network with weights that 16-bit floats can hold, as a file has them."""
    return network.half().float()


def to_tensors(rung: int, network: Network) -> dict[str, NDArray[np.float16]]:
    """A network's weights by the names that a file gives them."""
    tensors = {}
    for name, value in network.state_dict().items():
        _, index, kind = name.split(".")
        tensors[f"rung{rung}.conv{index}.{kind}"] = value.detach().cpu().contiguous().half().numpy()
    return tensors


def to_network(info: NetworkInfo, weights: Weights) -> Network:
    """A network from a file's weights."""
    network = Network(info.scale, info.layers, info.channels)
    state = {
        name: torch.from_numpy(weights.tensors[f"rung{info.rung}.conv{index}.{kind}"].astype(np.float32))
        for name in network.state_dict()
        for _, index, kind in [name.split(".")]
    }
    network.load_state_dict(state)
    return network
