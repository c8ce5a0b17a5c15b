"""Network interfaces: names that are safe in a command, and queries."""

from __future__ import annotations

import re
import socket

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,14}")


class Interface(str):
    """The name of a network interface. Raises ValueError if it is invalid."""

    __slots__ = ()

    def __new__(cls, name: str) -> Interface:
        if not _NAME.fullmatch(name):
            raise ValueError(f"{name!r} is not the name of a network interface")
        return super().__new__(cls, name)

    @property
    def number(self) -> int | None:
        """The kernel's number for it, or None if it does not exist. An interface made anew has a new number."""
        try:
            return socket.if_nametoindex(self)
        except OSError:
            return None
