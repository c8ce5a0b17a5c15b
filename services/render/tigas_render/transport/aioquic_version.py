"""The version of aioquic that `quic`, `h3` and `bulk` are written against: they use names that it keeps private."""

from __future__ import annotations

from importlib.metadata import version

from tigas_common.errors import StartError

MINOR_VERSION = "1.7"
"""As pyproject.toml holds it to."""


def check_aioquic() -> None:
    """Raises StartError if another minor version is installed. Comes before anything that imports the transport."""
    installed = version("aioquic")
    if not f"{installed}.".startswith(f"{MINOR_VERSION}."):
        raise StartError(
            f"aioquic {installed} is installed, but TIGAS needs {MINOR_VERSION}:"
            f" pip install 'aioquic=={MINOR_VERSION}.*'."
        )
