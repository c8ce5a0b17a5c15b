"""The command `tigas`, which every image has, whatever else it lacks."""

from __future__ import annotations

import subprocess
import sys
from ast import literal_eval
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

from rich.text import Text
from typer.main import get_command
from typer.testing import CliRunner

from tigas_common.cli import application
from tigas_common.extras import explained, install_command

ROOT = Path(__file__).parents[2]
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


WITHOUT_EXTRAS = """
import sys
from typer.testing import CliRunner

class OnlyTheBase:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in sys.argv[1].split(","):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, OnlyTheBase())
from tigas_common.cli import application
app = application()
for command in sys.stdin.read().splitlines():
    run = CliRunner().invoke(app, command.split())
    print(run.exit_code, repr(run.exception), repr(run.output), sep="|")
"""
"""Runs commands where nothing but the base requirements can be imported."""
NEEDS = {
    "cluster status": "cluster",
    "compare": "lab",
    "dash": "dash",
    "enhance train courtyard": "enhance",
    "experiment run no-such.toml": "lab",
    "movement show no-such.csv": "report",
    "quality score no-such": "quality",
    "quality fetch": "quality",
    "render": "render",
    "report no-such": "report",
    "scene info no-such.ply": "render",
    "scene ladder courtyard": "render",
    "store": "store",
    "trace plot traces/network/dsl.csv no-such.png": "traces",
}


def test_every_command_says_which_extra_is_missing_in_a_sentence() -> None:
    argv = [sys.executable, "-c", WITHOUT_EXTRAS, ",".join(sorted(NOT_EVERYWHERE | {"ray"}))]
    run = subprocess.run(argv, input="\n".join(NEEDS), cwd=ROOT, capture_output=True, text=True, check=True)
    for (command, extra), line in zip(NEEDS.items(), run.stdout.splitlines(), strict=True):
        code, exception, output = line.split("|")
        said = literal_eval(output)
        assert (code, exception) == ("1", "SystemExit(1)"), (command, line)
        assert said.endswith(f" not installed: {install_command(extra)}\n"), (command, said)
        assert said.count("\n") == 1, (command, said)


def test_a_module_of_our_own_that_is_missing_is_no_missing_extra() -> None:
    assert explained(ModuleNotFoundError("No module named 'tigas_common.x'", name="tigas_common.x"), ["dash"]) is None


def test_the_version_is_the_distributions() -> None:
    run = CliRunner().invoke(application(), ["--version"])
    assert (run.exit_code, run.output) == (0, f"tigas {version('tigas')}\n")


def test_shells_complete_commands() -> None:
    run = CliRunner().invoke(
        application(), env={"_TIGAS_COMPLETE": "complete_bash", "COMP_WORDS": "tigas sto", "COMP_CWORD": "1"}
    )
    assert run.output.split() == ["store"]


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
