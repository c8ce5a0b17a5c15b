"""Errors with a reason in one sentence."""

from __future__ import annotations


class RunFailed(Exception):
    """Reason why a run has no result. Other runs go on."""


class MetricUnavailable(Exception):
    """Reason why a metric cannot be computed here, and the command that helps. Other metrics can."""
