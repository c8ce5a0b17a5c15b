"""The program of a standby, which imports an edge's modules at a low priority, and then becomes an ordinary edge.

Imports at the top of this module would run at the normal priority.
"""

from __future__ import annotations

import importlib
import os
import threading

NICENESS = 10
"""Niceness of the imports, which get a tenth of the usual share of a busy processor."""


def _load() -> None:
    os.nice(NICENESS)  # only for this thread, because a thread may not raise its priority again
    importlib.import_module("tigas_render.workers.edge")


if __name__ == "__main__":
    loading = threading.Thread(target=_load)
    loading.start()
    loading.join()
    from tigas_render.workers.edge import run_edge
    from tigas_render.workers.process import run_worker, set_process_name

    set_process_name("spare edge")
    run_worker(run_edge)
