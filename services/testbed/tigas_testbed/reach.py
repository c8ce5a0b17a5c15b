"""Access to root-only files that a service needs, such as an interpreter below /root or a device.

`ip netns exec` gives a command its own mounts. There, a directory that the service's user may not enter is covered by
an empty one, into which only the needed files are bound. The machine's own files are not changed.
"""

from __future__ import annotations

import shlex
import stat
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from tigas_common.errors import StartError
from tigas_testbed.user import User

_SPARE = "/mnt"
"""Where mounts are prepared."""


def own_code() -> list[Path]:
    """The directories of this very Python and its packages, and the working directory."""
    places = (Path(place) for place in (sys.base_prefix, sys.prefix, *sys.path, "."))
    return [place.absolute() for place in places if place.is_dir()]


def reaching(user: User, needed: Iterable[Path], devices: Iterable[Path], argv: Sequence[str]) -> list[str]:
    """A command line that runs another one where `user` reaches all needed files, with private mounts under root.

    Raises StartError for a needed directory that is closed to the user itself.
    """
    commands = [*_doors(user, needed), *(line for device in devices for line in _device(user, device))]
    if not commands:
        return list(argv)
    script = "\n".join((*map(shlex.join, commands), f"cd {shlex.quote(str(Path.cwd()))}", 'exec "$@"'))
    return ["sh", "-ec", script, "sh", *argv]


def closed(user: User, path: Path) -> Path | None:
    """The outermost directory on the way to a path that a user may not enter."""
    return next((parent for parent in reversed(path.parents) if not user.may_enter(parent)), None)


def _doors(user: User, needed: Iterable[Path]) -> list[Sequence[str]]:
    """Commands that lead past closed directories."""
    behind: dict[Path, set[Path]] = {}
    for path in {each for place in needed for each in (place.absolute(), place.resolve())}:
        if path.is_dir() and not user.may_enter(path):
            raise StartError(f"The lab's services run as user {user.uid}, who may not enter {path}; change its mode.")
        if door := closed(user, path):
            behind.setdefault(door, set()).add(path)
    commands: list[Sequence[str]] = []
    for door, paths in sorted(behind.items()):
        commands.append(("mount", "-t", "tmpfs", "-o", "mode=0755,size=1m", "tigas", _SPARE))
        for path in sorted(paths):
            if paths.isdisjoint(path.parents):
                place = f"{_SPARE}/{path.relative_to(door)}"
                commands += [("mkdir", "-p", place), ("mount", "--rbind", str(path), place)]
        commands.append(("mount", "--move", _SPARE, str(door)))
    return commands


def _device(user: User, device: Path) -> list[Sequence[str]]:
    """Commands that give a user access to a root-only device; empty if the device is public or missing."""
    if not device.exists() or device.stat().st_mode & stat.S_IWOTH:
        return []
    copy = f"{_SPARE}/{device.name}"
    return [
        ("mount", "-t", "tmpfs", "-o", "mode=0700,size=1m", "tigas", _SPARE),
        ("cp", "-a", str(device), copy),
        ("chown", f"{user.uid}:{user.gid}", copy),
        ("mount", "--bind", copy, str(device)),
        ("umount", _SPARE),
    ]
