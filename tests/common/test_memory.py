"""Memory that is not needed any more goes back to the system."""

from __future__ import annotations

import subprocess
import sys

from tests.prerequisites import LINUX

PROGRAM = """
import threading
from pathlib import Path
from tigas_common.memory import give_back, keep_together

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

def use():
    [bytes(20_000) for _ in range(10_000)]

keep_together()
before = resident()
threads = [threading.Thread(target=use) for _ in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
give_back()
print(resident() - before)
"""


@LINUX.mark
def test_what_threads_have_freed_goes_back_to_the_system() -> None:
    grown = int(subprocess.run([sys.executable, "-c", PROGRAM], check=True, capture_output=True, text=True).stdout)
    assert grown < 10_000_000  # of 800 MB
