"""Errors of a run."""

from __future__ import annotations


class RunFailed(Exception):
    """Why a run has no result, in one sentence. Other runs go on."""
