"""The commands `tigas lab up`, `check`, `down` and `exec`, and `tigas demo`."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Annotated

import typer

from tigas_common.address import Address
from tigas_common.cli import in_a_sentence
from tigas_common.errors import StartError
from tigas_common.extras import require
from tigas_common.settings import MODELS

_Https = Annotated[
    Address | None,
    typer.Option(
        parser=Address.parse,
        metavar="HOST:PORT",
        help="The page over HTTPS, too, on 127.0.0.1, behind the same link.",
        show_default="off",
    ),
]

lab = typer.Typer(help="Run everything on this machine in network namespaces, without Docker.", no_args_is_help=True)


@lab.command("up")
def up(
    scenes: Annotated[Path | None, typer.Option(help="Models directory.", show_default=str(MODELS))] = None,
    traces: Annotated[Path | None, typer.Option(help="Directory of network traces.")] = None,
    trace: Annotated[str | None, typer.Option(help="Trace to play at start-up.")] = None,
    ladder: Annotated[
        str | None,
        typer.Option(
            metavar="scene|paper", help="Quality levels: each scene's own, or the paper's.", show_default="scene"
        ),
    ] = None,
    https: _Https = None,
) -> None:
    """Start the services behind the shaped link until Ctrl+C. The page is at http://localhost:8080."""
    from tigas_testbed.services import run_lab

    stop = _told_to_stop()
    with in_a_sentence(StartError, subprocess.CalledProcessError):
        require("dash", "render", "shaper", "store")
        run_lab(scenes=scenes, traces=traces, trace=trace, ladder=ladder, https=https, stop=stop)


@lab.command("check", context_settings={"ignore_unknown_options": True})
def check(
    more: Annotated[
        list[str] | None, typer.Argument(help="Options of the render service, as `tigas demo` takes.")
    ] = None,
    https: _Https = None,
) -> None:
    """Check whether this machine can run the lab, with these options: prints one sentence and exits with 1 if not."""
    from tigas_testbed.namespaces import check_rights
    from tigas_testbed.services import https_port

    with in_a_sentence(StartError, subprocess.CalledProcessError):
        if more:
            raise StartError(f"The lab takes no {more[0]}.")
        https_port(https)
        check_rights()


@lab.command("down")
def down() -> None:
    """Stop the lab, or clean up after one that was killed."""
    from tigas_testbed.namespaces import Lab, check_rights
    from tigas_testbed.services import NAME

    with in_a_sentence(StartError, subprocess.CalledProcessError):
        check_rights()
        Lab(NAME).remove()


@lab.command("exec", context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False})
def exec_(
    role: Annotated[str, typer.Argument(help="client, gateway or service.")],
    command: Annotated[list[str], typer.Argument(help="Command to run there, such as: chromium http://localhost:8080")],
) -> None:
    """Run a command inside the lab, such as a browser on the client."""
    from tigas_testbed.namespaces import ROLES, Lab, check_rights
    from tigas_testbed.services import NAME

    with in_a_sentence(StartError, subprocess.CalledProcessError):
        check_rights()
        found = next((known for known in ROLES if known == role), None)
        if found is None:
            raise StartError(f"Unknown role {role!r}: choose one of {', '.join(ROLES)}.")
        if not Lab(NAME).exists():
            raise StartError("The lab is not running: start it with `tigas lab up`.")
        argv = Lab(NAME).command(found, command)
        sys.stdout.flush()
        os.execvp(argv[0], argv)


def demo(
    render_options: Annotated[
        list[str] | None, typer.Argument(help="Options of the render service, after --, such as: -- --scenes models")
    ] = None,
) -> None:
    """Start the services on this machine, without a shaped link, until Ctrl+C. The page is at http://localhost:8080."""
    from tigas_testbed.services import run_demo

    stop = _told_to_stop()
    with in_a_sentence(StartError):
        require("dash", "render", "store")
        run_demo(render_options or (), stop)


def _told_to_stop() -> threading.Event:
    """Set by SIGINT and SIGTERM."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop
