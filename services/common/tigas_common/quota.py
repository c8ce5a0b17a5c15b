"""The part of a limit enforced by each of several processes."""

from __future__ import annotations

import math

SLACK = 3.25
"""Standard deviations above the mean that one process may take. Clients fall on processes at random: with the mean
alone, the fullest process refuses them long before the limit. With this, 64 clients of one address are all admitted at
6 or 12 processes in more than 99 % of cases, and no distribution admits more than two and a half times as many.
"""


def quota(total: int, processes: int) -> int:
    """One process' part of `total`."""
    mean = total / processes
    return min(total, math.ceil(mean + SLACK * math.sqrt(mean)))
