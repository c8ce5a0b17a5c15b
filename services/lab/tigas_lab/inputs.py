"""The poses of a run, in the scene's own frame, from what its configuration names as movement."""

from __future__ import annotations

from pathlib import Path

from tigas_common.errors import StartError
from tigas_common.wire import SceneInfo
from tigas_lab.configuration import Configuration
from tigas_lab.movement.generated import KINDS, generate
from tigas_lab.movement.placing import placed
from tigas_lab.movement.trace import MovementTrace
from tigas_lab.points import Point


def movement_points(configuration: Configuration, scene: SceneInfo) -> list[Point]:
    """The poses of a run, from 0 ms to its end or just after it. Raises StartError with one sentence."""
    return placed(movement_trace(configuration), scene)


def movement_trace(configuration: Configuration) -> MovementTrace:
    """A run's movement: generated, or from a file; as much as it needs. Raises StartError with one sentence."""
    name, duration_s = configuration.movement, configuration.duration_s
    if name in KINDS:
        return generate(name, duration_s, configuration.seed)
    path = Path(name)
    if not path.is_file():
        raise StartError(f"There is no movement {name!r}: neither a file nor one of {', '.join(KINDS)}.")
    trace = MovementTrace.read(path)
    if trace.duration_ms < duration_s * 1000:
        raise StartError(
            f"The movement {name} lasts {trace.duration_ms / 1000:.1f} s, less than a run's {duration_s:g} s: "
            "choose a shorter duration."
        )
    return trace.until(duration_s * 1000)
