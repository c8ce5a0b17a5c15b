"""Packages that plain `pip install tigas` omits, and the command that installs them."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from tigas_common.errors import StartError

PROJECT = "tigas"
REQUIREMENT = re.compile(r"""(?P<name>[\w.-]+)[^;]*; extra == ['"](?P<extra>[\w-]+)['"]""")
"""A package that the extra has on every platform, in wheel spelling."""


def install_command(*extras: str) -> str:
    """The command that adds extras to this installation, from its own source: a checkout, a wheel or an index."""
    named = f"{PROJECT}[{','.join(extras)}]"
    origin = _origin()
    url = origin.get("url", "")
    if not url or (url.startswith("file:") and not _path(url).exists()):
        return f"pip install '{named}'"
    if origin.get("dir_info", {}).get("editable"):
        return f"pip install -e '{_path(url)}{named.removeprefix(PROJECT)}'"
    if vcs := origin.get("vcs_info"):
        url = f"{vcs['vcs']}+{url}@{vcs['commit_id']}"
    return f"pip install '{named} @ {url}'"


def missing_packages(*extras: str) -> list[str]:
    """The packages of these extras that are not installed."""
    required = filter(None, map(REQUIREMENT.fullmatch, distribution(PROJECT).requires or ()))
    return sorted({each["name"] for each in required if each["extra"] in extras and not _is_installed(each["name"])})


def require(*extras: str) -> None:
    """Raise StartError with the command that installs them if packages of these extras are missing."""
    if missing := missing_packages(*extras):
        named = ", ".join(missing[:3]) + (f" and {len(missing) - 3} more" if missing[3:] else "")
        are = "is" if len(missing) == 1 else "are"
        raise StartError(f"{named} {are} not installed: {install_command(*extras)}")


def explained(error: ModuleNotFoundError, extras: Sequence[str]) -> StartError | None:
    """Install command for the missing modules of a command with these extras; None if that would not help."""
    module = (error.name or "").partition(".")[0]
    if not module or module.startswith(PROJECT) or not extras:
        return None
    return StartError(f"{module} is not installed: {install_command(*extras)}")


def _is_installed(name: str) -> bool:
    try:
        distribution(name)
    except PackageNotFoundError:
        return False
    return True


def _origin() -> dict[str, Any]:
    """The source of this installation (PEP 610); empty for an index."""
    origin: dict[str, Any] = json.loads(distribution(PROJECT).read_text("direct_url.json") or "{}")
    return origin


def _path(url: str) -> Path:
    return Path(unquote(urlsplit(url).path))
