"""Dependencies of the store."""

from __future__ import annotations

import subprocess
import sys


def test_the_store_needs_neither_a_browser_nor_torch() -> None:
    script = (
        "import sys; import tigas_experiments.store.main; "
        "print([name for name in ('playwright', 'torch', 'numba', 'av', 'matplotlib') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
