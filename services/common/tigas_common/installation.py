"""The installation: its commit, its extras and how to add them, and the supported versions of packages."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from tigas_common.errors import StartError

PROJECT = "tigas"
REQUIREMENT = re.compile(r"""(?P<name>[\w.-]+)[^;]*; extra == ['"](?P<extra>[\w-]+)['"]""")
"""A package that an extra requires on every platform, in the metadata of a wheel."""
MAKE_EXTRAS = ("gpu", "lab")
"""Extras that the Makefile installs into its own environment, with the right build of PyTorch."""
COMMIT_VARIABLE = "TIGAS_COMMIT"
"""Environment variable with the commit, set when container images are built, as they have no repository."""


def this_commit() -> str | None:
    """The value of COMMIT_VARIABLE, or the working tree's commit, with `-dirty` if modified; None if neither exists."""
    if configured := os.environ.get(COMMIT_VARIABLE):
        return configured
    command = ("git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*")
    alone = os.environ | {"GIT_OPTIONAL_LOCKS": "0"}  # avoids taking locks in the user's repository
    try:
        run = subprocess.run(
            command, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=10, env=alone, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return run.stdout.strip() or None


def check_versions(*packages: str) -> None:
    """Raise StartError if an unsupported version of a package is installed. Call it before importing the package.

    Another minor version of these packages may have renamed the private names in use.
    """
    for package in packages:
        try:
            installed = version(package)
        except PackageNotFoundError:
            continue  # the import will report it
        first, end = _version_bounds(package)
        if not _numbers(first) <= _numbers(installed) < _numbers(end):
            needed = f"{package}>={first},<{end}"
            raise StartError(f"{package} {installed} is installed, but TIGAS needs {needed}: pip install '{needed}'.")


def install_command(*extras: str) -> str:
    """The command that adds extras to this installation from its source: a checkout, a wheel or an index."""
    named = f"{PROJECT}[{','.join(extras)}]"
    origin = _origin()
    url = origin.get("url", "")
    if not url or (url.startswith("file:") and not _path(url).exists()):
        return f"pip install '{named}'"
    if origin.get("dir_info", {}).get("editable"):
        if len(extras) == 1 and extras[0] in MAKE_EXTRAS and Path(sys.prefix) == _path(url) / ".venv":
            return f"make -C {_path(url)} {extras[0]}"
        return f"pip install -e '{_path(url)}{named.removeprefix(PROJECT)}'"
    if vcs := origin.get("vcs_info"):
        url = f"{vcs['vcs']}+{url}@{vcs['commit_id']}"
    return f"pip install '{named} @ {url}'"


def missing_packages(*extras: str) -> list[str]:
    required = filter(None, map(REQUIREMENT.fullmatch, distribution(PROJECT).requires or ()))
    return sorted({each["name"] for each in required if each["extra"] in extras and not _is_installed(each["name"])})


def require_extras(*extras: str) -> None:
    """Raise StartError, with the command to install them, if packages of these extras are missing."""
    if missing := missing_packages(*extras):
        named = ", ".join(missing[:3]) + (f" and {len(missing) - 3} more" if missing[3:] else "")
        are = "is" if len(missing) == 1 else "are"
        raise StartError(f"{named} {are} not installed: {install_command(*extras)}")


def missing_module_error(error: ModuleNotFoundError, extras: Sequence[str]) -> StartError | None:
    """Error with the install command for the missing module of a command; None if its extras would not help."""
    module = (error.name or "").partition(".")[0]
    if not module or module.startswith(PROJECT) or not extras:
        return None
    return StartError(f"{module} is not installed: {install_command(*extras)}")


def _version_bounds(package: str) -> tuple[str, str]:
    """The first supported version and the first unsupported one, from the narrowest requirement in pyproject.toml."""
    pattern = re.compile(rf"{package}(?:\[\w+\])?([<>=][^;]*)")
    requirements = filter(None, map(pattern.match, distribution(PROJECT).requires or ()))
    found = (dict(re.findall(r"(>=|<)([\d.]+)", requirement[1])) for requirement in requirements)
    return min(((bounds[">="], bounds["<"]) for bounds in found), key=lambda bounds: _numbers(bounds[1]))


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(".")[:2])


def _is_installed(name: str) -> bool:
    try:
        distribution(name)
    except PackageNotFoundError:
        return False
    return True


def _origin() -> dict[str, Any]:
    """The source of this installation (PEP 610); empty if it came from an index."""
    origin: dict[str, Any] = json.loads(distribution(PROJECT).read_text("direct_url.json") or "{}")
    return origin


def _path(url: str) -> Path:
    return Path(unquote(urlsplit(url).path))
