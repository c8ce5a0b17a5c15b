"""Labs of tests: each has a unique name, and leftovers of killed test runs are removed."""

from __future__ import annotations

import itertools
import os
import re
import subprocess
from contextlib import suppress

from tigas_common.errors import StartError
from tigas_testbed.namespaces import Lab
from tigas_testbed.user import User

NOBODY = User(65534, 65534)
"""User of the tests' services, whoever runs the tests."""
_numbers = itertools.count()
_TESTS_CLIENT = re.compile(r"^tigas-(t\d+n\d+)-client\b", re.MULTILINE)


def new_lab() -> Lab:
    """A name unique to a test."""
    return Lab(f"t{os.getpid()}n{next(_numbers)}")


def remove_abandoned() -> None:
    """Remove every test's lab whose process has ended."""
    namespaces = subprocess.run(("ip", "netns", "list"), check=True, capture_output=True, text=True).stdout
    for name in _TESTS_CLIENT.findall(namespaces):
        with suppress(StartError), Lab(name).up():  # removes leftovers, unless they are in use
            pass
