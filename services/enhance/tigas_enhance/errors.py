"""What can go wrong beside the training itself, each with one sentence for whoever started it."""

from __future__ import annotations

from tigas_common.errors import StartError


class RenderFailed(StartError):
    """The render service did not give what was asked for."""


class NothingToLearn(StartError):
    """No view of the scene shows anything, or the ladder has no rung below the best."""
