"""The command `tigas`, which every image has, whatever else it lacks."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

from rich.text import Text
from typer.main import get_command

from tigas_common.cli import application

LOADED = """
import sys
from importlib.metadata import entry_points
from tigas_common.cli import COMMANDS
for point in entry_points(group=COMMANDS):
    point.load()
print(*sorted({name.partition(".")[0] for name in sys.modules}))
"""
NOT_EVERYWHERE = {
    "PIL",
    "aioquic",
    "av",
    "filelock",
    "httpx",
    "jinja2",
    "matplotlib",
    "numba",
    "numpy",
    "playwright",
    "pooch",
    "psutil",
    "requests",
    "scipy",
    "skimage",
    "starlette",
    "torch",
    "uvicorn",
    "zipstream",
}


def test_all_commands_load_without_what_only_some_services_have() -> None:
    run = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert {"tigas_experiments", "tigas_render", "tigas_shaper", "tigas_dash"} <= loaded
    assert not loaded & NOT_EVERYWHERE


def help_texts(command: object) -> Iterator[str]:
    """What a command, its parameters and its subcommands say in --help."""
    yield getattr(command, "help", None) or ""
    for parameter in getattr(command, "params", ()):
        yield getattr(parameter, "help", None) or ""
    for subcommand in getattr(command, "commands", {}).values():
        yield from help_texts(subcommand)


def test_help_shows_every_word_of_its_texts() -> None:
    texts = list(help_texts(get_command(application())))
    assert len(texts) > 50
    for text in texts:
        assert Text.from_markup(text).plain == text, "Rich takes [words in brackets] for markup and drops them"
