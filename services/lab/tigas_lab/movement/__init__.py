"""How a viewer moves: traces, generated and recorded, and where they are in a scene (docs/movement.md)."""

from tigas_lab.movement.errors import MovementError
from tigas_lab.movement.placing import placed
from tigas_lab.movement.trace import MovementTrace

__all__ = ["MovementError", "MovementTrace", "placed"]
