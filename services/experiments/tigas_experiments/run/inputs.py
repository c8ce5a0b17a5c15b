"""Inputs of a run: poses in the scene's frame, and the files named by its configuration."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from tigas_common.errors import StartError
from tigas_common.files import open_regular
from tigas_common.wire.render import SceneInfo
from tigas_experiments.movement.generated import KINDS, generate
from tigas_experiments.movement.trace import MovementTrace, place_in_scene
from tigas_experiments.records.folder import InputDigests
from tigas_experiments.wire.movement import TimedPose
from tigas_experiments.wire.run import Configuration, Network

DECIMALS = 9
"""Decimals included in the points' digest, so that rounding differences between math libraries do not matter."""


class Inputs:
    """Files named by configurations, relative to a directory.

    Methods raise StartError with one sentence for missing or invalid files.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory

    def points(self, configuration: Configuration, scene: SceneInfo) -> list[TimedPose]:
        """The poses of a run, from 0 ms to its end or just after it."""
        return place_in_scene(self.movement(configuration), scene)

    def network(self, network: Network) -> Network:
        """The network, with a path to its trace file that can be opened."""
        if network.trace_file is None:
            return network
        return network.model_copy(update={"trace_file": self.directory / network.trace_file})

    def digests(self, configuration: Configuration) -> InputDigests:
        """Digests of the current files; traces that the shaper knows by name have none."""
        movement, trace = self._movement_file(configuration.movement), self.network(configuration.network).trace_file
        return InputDigests(
            movement=None if movement is None else _sha256(movement), trace=None if trace is None else _sha256(trace)
        )

    def movement(self, configuration: Configuration) -> MovementTrace:
        """The movement of a run, in a levelled frame."""
        name, begin_s = configuration.movement, configuration.movement_offset_s
        end_s = begin_s + configuration.duration_s
        path = self._movement_file(name)
        if path is None:
            return generate(name, end_s, configuration.seed).slice(begin_s * 1000, end_s * 1000)
        trace = MovementTrace.read(path)
        if trace.duration_ms < end_s * 1000 - 0.5:  # segments start at whole milliseconds
            after = f", begun at {begin_s:g} s" if begin_s else ""
            raise StartError(
                f"The movement {name} lasts {trace.duration_ms / 1000:.1f} s, less than a run's "
                f"{configuration.duration_s:g} s{after}: choose a shorter duration."
            )
        return trace.slice(begin_s * 1000, end_s * 1000)

    def _movement_file(self, name: str) -> Path | None:
        """Path of a movement file; None for a generated movement."""
        if name in KINDS:
            return None
        path = self.directory / name
        if not path.is_file():
            raise StartError(f"There is no movement {name!r}: neither a file nor one of {', '.join(KINDS)}.")
        return path


def points_sha256(points: Sequence[TimedPose]) -> str:
    """SHA-256 of the times (ms), positions and quaternions, in hexadecimal."""
    rows = np.array([[point["t_ms"], *point["position"], *point["quaternion"]] for point in points], dtype="<f8")
    # + 0.0 turns a negative zero into zero
    return hashlib.sha256((np.round(rows, DECIMALS) + 0.0).tobytes()).hexdigest()


def _sha256(path: Path) -> str:
    try:
        told = path.stat()
        return _digest(path, told.st_mtime_ns, told.st_size)
    except OSError as error:
        raise StartError(f"{path} cannot be read: {error.strerror or error}.") from None


@lru_cache(1000)
def _digest(path: Path, _modified_ns: int, _size: int) -> str:
    """Digest of a file, cached because many runs share it."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
