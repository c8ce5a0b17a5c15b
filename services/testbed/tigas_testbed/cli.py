"""The commands `tigas lab up`, `check`, `down` and `exec`, and `tigas demo`."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from queue import SimpleQueue
from typing import Annotated

from tigas_common.cli import report_errors
from tigas_common.command import POSITIONAL, REST, Command, Group, Metavar
from tigas_common.errors import StartError
from tigas_common.installation import install_command, missing_packages, require_extras
from tigas_common.settings import Listen
from tigas_testbed.namespaces import Lab, Role, check_rights
from tigas_testbed.services import NAME, https_port, run_demo, run_lab


class Check(Command):
    """Check whether this machine can run the lab. If not, print one sentence and exit with status 1."""

    https: Listen | None = None
    """Address of the page over HTTPS, on 127.0.0.1 and behind the same link."""

    def run(self) -> None:
        with report_errors(StartError, subprocess.CalledProcessError):
            https_port(self.https)
            check_rights()


class Up(Check):
    """Start the services behind the shaped link until Ctrl+C. The page is at http://localhost:8080.

    The services have their own settings, such as TIGAS_RENDER_SCENES and TIGAS_SHAPER_TRACES.
    """

    def run(self) -> None:
        stop = _stop_event()
        with report_errors(StartError, subprocess.CalledProcessError):
            require_extras("dash", "render", "shaper")
            run_lab(https=self.https, store=_has_store(), stop=stop)


class Down(Command):
    """Stop the lab, or clean up after one that was killed."""

    def run(self) -> None:
        with report_errors(StartError, subprocess.CalledProcessError):
            check_rights()
            Lab(NAME).stop()
            Lab(NAME).remove()


class Exec(Command):
    """Run a command inside the lab, such as a browser on the client."""

    role: Annotated[Role, POSITIONAL]
    """Namespace: client, gateway or service."""
    command: Annotated[tuple[str, ...], REST, Metavar("COMMAND")]
    """Command to run there, such as: chromium http://localhost:8080"""

    def run(self) -> None:
        with report_errors(StartError, subprocess.CalledProcessError):
            check_rights()
            if not Lab(NAME).exists():
                raise StartError("The lab is not running: start it with `tigas lab up`.")
            argv = Lab(NAME).command(self.role, self.command)
            sys.stdout.flush()
            os.execvp(argv[0], argv)


lab = Group(
    "Run everything on this machine in network namespaces, without Docker.",
    {"up": Up, "check": Check, "down": Down, "exec": Exec},
)


class Demo(Command):
    """Start the services on this machine, without a shaped link, until Ctrl+C. The page is at http://localhost:8080."""

    render_options: Annotated[tuple[str, ...], REST, Metavar("OPTIONS")] = ()
    """Options of the render service, such as -- --scenes models"""

    def run(self) -> None:
        stop = _stop_event()
        require_extras("dash", "render")
        run_demo(self.render_options, stop, store=_has_store())


def _has_store() -> bool:
    """Whether the experiment store can run. If not, print the command that installs it."""
    installed = not missing_packages("lab")
    if not installed:
        print(f"Experiments are disabled; to enable them: {install_command('lab')}", flush=True)
    return installed


def _stop_event() -> threading.Event:
    """An event set on SIGINT and SIGTERM by a thread, as a handler may run while this thread holds the event's lock."""
    stop = threading.Event()
    signals: SimpleQueue[int] = SimpleQueue()

    def wait() -> None:
        signals.get()
        stop.set()

    threading.Thread(target=wait, daemon=True).start()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: signals.put(number))
    return stop
