"""Writes the locks: for each extra of pyproject.toml, and for building the wheel, all packages with their digests.

`make lock` runs it after a change of pyproject.toml or constraints.txt. PyTorch is in none of the locks, because each
of its indexes has other files of a version, and the CUDA packages that PyPI's asks for are in that of `gpu` alone.
"""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
EXTRAS = ("dev", "gpu", "render", "cluster", "webrtc", "store", "shaper")
"""What `make` and the images install."""
BUILD = "build"
"""The lock of what builds the wheel; that of `dev` has it, too."""
PYTHON = "3.11"
"""The oldest; the locks hold for newer ones and for every platform."""
PYTORCH = ("torch",)
CUDA = ("cuda-", "nvidia-", "triton")


def lock(extra: str) -> Path:
    """Where an extra's lock is."""
    return ROOT / f"locks/{extra}.txt"


def header() -> str:
    """A lock's first line, which says what it was made from."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    asked = (project["build-system"]["requires"], project["project"]["dependencies"])
    pins = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
    made_from = json.dumps([*asked, project["project"]["optional-dependencies"], sorted(pins)], sort_keys=True)
    digest = hashlib.sha256(made_from.encode()).hexdigest()
    return f"# Made by `make lock` from pyproject.toml and constraints.txt ({digest[:16]})"


def stale() -> list[str]:
    """The locks that were made from something else."""
    first = header()
    locks = ((name, lock(name)) for name in (*EXTRAS, BUILD))
    return [name for name, path in locks if not (path.is_file() and path.read_text().startswith(f"{first}\n"))]


def resolved(extra: str) -> str:
    """Requirements with hashes, as uv finds them on PyPI."""
    build = (*tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]["requires"], "editables")
    options = ("--universal", "--generate-hashes", "--no-annotate", "--no-header", "--quiet")
    pinned = ("--python-version", PYTHON, "--constraint", "constraints.txt")
    project = () if extra == BUILD else ("--extra", extra, "pyproject.toml")
    argv = (sys.executable, "-m", "uv", "pip", "compile", *options, *pinned, *project, "-")
    more = "\n".join(build) if extra in (BUILD, "dev") else ""
    return subprocess.run(argv, cwd=ROOT, input=more, check=True, stdout=subprocess.PIPE, text=True).stdout


def kept(requirements: str, extra: str) -> Iterator[str]:
    """The requirements that belong into an extra's lock, each with its hashes."""
    left_out = PYTORCH if extra == "gpu" else PYTORCH + CUDA
    for requirement in re.split(r"^(?=\S)", requirements, flags=re.MULTILINE):
        if requirement and not requirement.startswith(left_out):
            yield requirement


def main() -> None:
    """Write all of them."""
    for extra in (*EXTRAS, BUILD):
        lock(extra).write_text(f"{header()}\n{''.join(kept(resolved(extra), extra))}")


if __name__ == "__main__":
    try:
        main()
    except (FileNotFoundError, subprocess.CalledProcessError) as error:
        sys.exit(f"The locks could not be made: {error}")
