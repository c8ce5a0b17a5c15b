"""The user that runs the lab's services: ordinary and without capabilities, although the lab itself needs root.

Some required files may only be accessible to root, such as an interpreter below /root or a device. `ip netns exec`
gives a command its own mounts: there, a directory that the user may not enter is covered by an empty one, into which
only the required files are bound. The machine's own files are not changed.
"""

from __future__ import annotations

import os
import pwd
import shlex
import stat
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tigas_common.errors import StartError
from tigas_common.files import NOBODY, change_owner

CACHE = Path("/var/cache")
"""Parent of home directories for users without one."""
_SPARE = "/mnt"
"""Where mounts are prepared."""


@dataclass(frozen=True, slots=True)
class User:
    """A user and their main group; services run without their other groups."""

    uid: int
    gid: int

    @classmethod
    def sudo_caller(cls, environment: Mapping[str, str]) -> User:
        """The user that invoked sudo, or root."""
        return cls(int(environment.get("SUDO_UID", 0)), int(environment.get("SUDO_GID", 0)))

    @classmethod
    def service_user(cls, environment: Mapping[str, str], directory: Path) -> User:
        """The caller, or else the owner of the working directory; if both are root, the system's `nobody`."""
        state = directory.stat()
        for user in (cls.sudo_caller(environment), cls(state.st_uid, state.st_gid)):
            if user.uid and user.gid:
                return user
        return cls(NOBODY, NOBODY)

    def environment(self) -> dict[str, str]:
        """Variables for the user's identity and home, which is created if missing."""
        try:
            known = pwd.getpwuid(self.uid)
        except KeyError:
            name, home = str(self.uid), Path("/nonexistent")
        else:
            name, home = known.pw_name, Path(known.pw_dir)
        if not home.is_dir():
            home = CACHE / f"tigas-{self.uid}"
            home.mkdir(mode=0o700, parents=True, exist_ok=True)
            os.chown(home, self.uid, self.gid, follow_symlinks=False)
        return {"HOME": str(home), "USER": name, "LOGNAME": name}

    def take_ownership(self, folder: Path) -> None:
        """Make the user the owner of a folder, which is created if missing. Raises StartError."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            change_owner(folder, self.uid, self.gid)
        except OSError as error:
            raise StartError(f"{folder} cannot be given to user {self.uid}: {error.strerror or error}.") from None

    def can_enter(self, folder: Path) -> bool:
        """Whether a folder's mode lets the user reach its contents."""
        state = folder.stat()
        if state.st_uid == self.uid:
            return bool(state.st_mode & stat.S_IXUSR)
        return bool(state.st_mode & (stat.S_IXGRP if state.st_gid == self.gid else stat.S_IXOTH))

    def command(self, argv: Sequence[str], capabilities: Iterable[str] = ()) -> list[str]:
        """Command line, for root, that runs another one as this user, with these capabilities (capabilities(7), in
        lower case and without `cap_`) and no way to gain others."""
        held = ",".join(("-all", *(f"+{capability}" for capability in capabilities)))
        return [
            "setpriv",
            f"--reuid={self.uid}",
            f"--regid={self.gid}",
            "--clear-groups",
            f"--inh-caps={held}",
            f"--ambient-caps={held}",
            f"--bounding-set={held}",
            "--no-new-privs",
            "--pdeathsig=KILL",
            *argv,
        ]


def code_folders() -> list[Path]:
    """Directories of the current interpreter and its packages, and the working directory."""
    places = (Path(place) for place in (sys.base_prefix, sys.prefix, *sys.path, "."))
    return [place.absolute() for place in places if place.is_dir()]


def grant_access(user: User, needed: Iterable[Path], devices: Iterable[Path], argv: Sequence[str]) -> list[str]:
    """Command line that runs another one such that `user` reaches all needed files, through private mounts under root.

    Raises StartError for a needed directory that is closed to the user itself.
    """
    commands = [
        *_mount_commands(user, needed),
        *(line for device in devices for line in _device_commands(user, device)),
    ]
    if not commands:
        return list(argv)
    script = "\n".join((*map(shlex.join, commands), f"cd {shlex.quote(str(Path.cwd()))}", 'exec "$@"'))
    return ["sh", "-ec", script, "sh", *argv]


def _mount_commands(user: User, needed: Iterable[Path]) -> list[Sequence[str]]:
    """Commands that make needed paths reachable past closed directories."""
    behind: dict[Path, set[Path]] = {}
    for path in {each for place in needed for each in (place.absolute(), place.resolve())}:
        if path.is_dir() and not user.can_enter(path):
            raise StartError(f"The lab's services run as user {user.uid}, who may not enter {path}; change its mode.")
        if closed_folder := next((parent for parent in reversed(path.parents) if not user.can_enter(parent)), None):
            behind.setdefault(closed_folder, set()).add(path)
    commands: list[Sequence[str]] = []
    for closed_folder, paths in sorted(behind.items()):
        commands.append(("mount", "-t", "tmpfs", "-o", "mode=0755,size=1m", "tigas", _SPARE))
        for path in sorted(paths):
            if paths.isdisjoint(path.parents):
                place = f"{_SPARE}/{path.relative_to(closed_folder)}"
                commands += [("mkdir", "-p", place), ("mount", "--rbind", str(path), place)]
        commands.append(("mount", "--move", _SPARE, str(closed_folder)))
    return commands


def _device_commands(user: User, device: Path) -> list[Sequence[str]]:
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
