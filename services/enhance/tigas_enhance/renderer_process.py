"""A private render service."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

from tigas_common.processes import running, tigas
from tigas_enhance.errors import RenderFailed

STOP_S = 5


@contextmanager
def render_service(device: str, *, own_ladders: bool = True) -> Iterator[str]:
    """Run a render service on this machine until the context ends, and give its URL.

    own_ladders: whether scenes have their own ladders, or all have the paper's.
    Raises RenderFailed with its last line of output if it does not start.
    """
    ladder = "scene" if own_ladders else "paper"
    options = ["--http", "127.0.0.1:0", "--quic", "off", "--device", device, "--ladder", ladder]
    with running(tigas("render", *options), STOP_S, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        yield _url(process)  # and hardly any output after it, as a service without visitors has little to report


def _url(process: subprocess.Popen[bytes]) -> str:
    """Wait for the service to announce its URL."""
    assert process.stdout is not None
    last = "it says nothing"
    for line in process.stdout:
        text = line.decode(errors="replace").strip()
        if found := re.search(r"Open (http://\S+)/", text):
            return found[1]
        last = text or last
    raise RenderFailed(f"The render service did not start: {last}")
