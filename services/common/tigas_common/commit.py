"""Which commit the running code is of."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

VARIABLE = "TIGAS_COMMIT"
"""Says it where there is no repository: images are built with it."""


def this_commit() -> str | None:
    """The value of VARIABLE, or the working tree's commit, with `-dirty` if it was changed; None if both are
    unavailable.
    """
    if told := os.environ.get(VARIABLE):
        return told
    command = ("git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*")
    alone = os.environ | {"GIT_OPTIONAL_LOCKS": "0"}  # so that the user's git configuration does not interfere
    try:
        run = subprocess.run(
            command, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=10, env=alone, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return run.stdout.strip() or None
