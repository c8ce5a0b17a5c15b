"""Errors outside the training itself, each with one sentence for the user."""

from __future__ import annotations

from tigas_common.errors import StartError


class RenderFailed(StartError):
    """The render service did not deliver a requested frame."""


class NothingToLearn(StartError):
    """No view of the scene shows anything, or the ladder has no rung below the best."""
