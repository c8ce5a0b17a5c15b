"""A render service of our own, for as long as it is needed."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tigas_common.processes import end, tigas, with_parent
from tigas_enhance.errors import RenderFailed

STOP_S = 5


@contextmanager
def render_service(scenes: Path | None, device: str, *, own_ladders: bool = True) -> Iterator[str]:
    """The URL of a render service on this machine, which ends with the context, or with us if we are killed.

    own_ladders: whether scenes have ladders of their own, or all have the paper's.
    Raises RenderFailed with what it said if it does not start.
    """
    ladder = "scene" if own_ladders else "paper"
    options = ["--http", "127.0.0.1:0", "--quic", "off", "--device", device, "--ladder", ladder]
    command = with_parent(tigas("render", *options, *(["--scenes", str(scenes)] if scenes else [])))
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True)
    try:
        yield _url(process)  # and hardly anything after it, as a service without visitors has little to say
    finally:
        end(process, STOP_S)
        if process.stdout:
            process.stdout.close()


def _url(process: subprocess.Popen[bytes]) -> str:
    """What it announces once it answers."""
    assert process.stdout is not None
    last = "it says nothing"
    for line in process.stdout:
        text = line.decode(errors="replace").strip()
        if found := re.search(r"Open (http://\S+)/", text):
            return found[1]
        last = text or last
    raise RenderFailed(f"The render service did not start: {last}")
