"""Errors with a reason in one sentence."""

from __future__ import annotations


class RunFailed(Exception):
    """Reason why a run has no result; other runs continue."""


class MetricUnavailable(Exception):
    """Reason why a metric cannot be computed here, with the command that fixes it. Other metrics are unaffected."""
