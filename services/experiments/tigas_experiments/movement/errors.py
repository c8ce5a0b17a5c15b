"""What is wrong with a movement."""

from __future__ import annotations

from tigas_common.errors import StartError


class MovementError(StartError):
    """Why a text is no movement, or cannot be imported: one sentence, which names the line where there is one."""
