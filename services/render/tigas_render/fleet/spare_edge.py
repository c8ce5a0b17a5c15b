"""The process of the edge that waits: it imports what an edge needs, at a low priority, and then becomes one."""

from __future__ import annotations

import importlib
import os
import threading

NICENESS = 10
"""While it imports: it gets a tenth of what others get of a busy processor."""


def _load() -> None:
    os.nice(NICENESS)  # of this thread alone: what has become less important may never become more so again
    importlib.import_module("tigas_render.fleet.edge")


if __name__ == "__main__":
    loading = threading.Thread(target=_load)
    loading.start()
    loading.join()
    from tigas_render.fleet.edge import edge
    from tigas_render.fleet.process import call_it, run

    call_it("spare edge")
    run(edge)
