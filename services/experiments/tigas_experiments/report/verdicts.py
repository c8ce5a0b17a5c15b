"""What a claim is, and how an interval decides it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from tigas_experiments.report.blocks import Estimate

Verdict = Literal["holds", "does not hold", "not certain", "no data"]
OURS = "ours"


@dataclass(frozen=True, slots=True)
class Claim:
    """One, and what the runs say of it."""

    text: str
    whose: str
    """The paper's, with the section, or ours."""
    verdict: Verdict
    figures: str
    """What the verdict rests on."""


def of_interval(estimate: Estimate | None, judge: Callable[[float, float], Verdict]) -> Verdict:
    """What the whole interval says; `not certain` without one."""
    if estimate is None or estimate.interval is None or math.isnan(estimate.mean):
        return "not certain"
    return judge(*estimate.interval)


def judged(holds: bool, fails: bool) -> Verdict:
    """Of what may be neither."""
    return "holds" if holds else "does not hold" if fails else "not certain"


def all_of(verdicts: Iterable[Verdict]) -> Verdict:
    """Of what holds only if every part does."""
    found = set(verdicts)
    return "does not hold" if "does not hold" in found else "not certain" if "not certain" in found else "holds"
