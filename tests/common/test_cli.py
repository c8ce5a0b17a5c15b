"""The command `tigas`, which is in every image."""

from __future__ import annotations

import io
import logging
import subprocess
import sys
from ast import literal_eval
from importlib.metadata import version
from pathlib import Path

import pytest
from rich.table import Table

from tests.command import tigas
from tigas_common.cli import command_entry_points, report_errors
from tigas_common.command import Command, Group, parameters
from tigas_common.errors import StartError
from tigas_common.installation import install_command, missing_module_error
from tigas_common.terminal import LogFormatter, make_console, printable

ROOT = Path(__file__).parents[2]
LOADED = """
import sys
from importlib.metadata import entry_points
from tigas_common.cli import COMMANDS
for point in entry_points(group=COMMANDS):
    point.load()
print(*sorted({name.partition(".")[0] for name in sys.modules}))
"""
NOT_EVERYWHERE = frozenset(
    [
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
    ]
)


WITHOUT_EXTRAS = """
import sys
from tests.command import tigas

class OnlyTheBase:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in sys.argv[1].split(","):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, OnlyTheBase())
for command in sys.stdin.read().splitlines():
    run = tigas(*command.split())
    print(run.exit_code, repr(run.output), sep="|")
"""
"""Runs commands where nothing but the base requirements can be imported."""
NEEDS = {
    "cluster status": "cluster",
    "dash": "dash",
    "enhance train courtyard": "lab",
    "experiment run no-such.toml": "lab",
    "movement show no-such.csv": "lab",
    "paper quick": "lab",
    "quality score no-such": "lab",
    "quality fetch": "lab",
    "render": "render",
    "report no-such": "lab",
    "scene info no-such.ply": "render",
    "scene ladder courtyard": "render",
    "store": "lab",
    "trace info traces/network/dsl.csv --plot no-such.png": "lab",
}


def test_every_command_says_which_extra_is_missing_in_a_sentence() -> None:
    argv = [sys.executable, "-c", WITHOUT_EXTRAS, ",".join(sorted(NOT_EVERYWHERE | {"ray"}))]
    run = subprocess.run(argv, input="\n".join(NEEDS), cwd=ROOT, capture_output=True, text=True, check=True)
    for (command, extra), line in zip(NEEDS.items(), run.stdout.splitlines(), strict=True):
        code, output = line.split("|", 1)
        said = literal_eval(output)
        assert code == "1", (command, line)
        assert said.endswith(f" not installed: {install_command(extra)}\n"), (command, said)
        assert said.count("\n") == 1, (command, said)


def test_a_module_of_our_own_that_is_missing_is_no_missing_extra() -> None:
    assert (
        missing_module_error(ModuleNotFoundError("No module named 'tigas_common.x'", name="tigas_common.x"), ["dash"])
        is None
    )


def test_the_version_is_the_distributions() -> None:
    run = tigas("--version")
    assert (run.exit_code, run.output) == (0, f"tigas {version('tigas')}\n")


def test_all_commands_load_without_what_only_some_services_have() -> None:
    run = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert {"tigas_experiments", "tigas_render", "tigas_shaper", "tigas_dash"} <= loaded
    assert not loaded & NOT_EVERYWHERE


MAX_PARAMETERS = 100


def commands() -> dict[str, type[Command]]:
    found = {}
    for name, point in command_entry_points().items():
        loaded = point.load()
        if isinstance(loaded, Group):
            found.update({f"{name} {each}": command for each, command in loaded.commands.items()})
        else:
            found[name] = loaded
    return found


def test_help_lists_every_command_in_a_line() -> None:
    lines = tigas("--help").stdout.splitlines()
    for name in command_entry_points():
        assert sum(line.startswith(f"  {name} ") and line.endswith(".") for line in lines) == 1, name


@pytest.mark.parametrize("name", commands())
def test_help_describes_every_parameter(name: str) -> None:
    command, text = commands()[name], " ".join(tigas(*name.split(), "--help").stdout.split())
    assert (command.__doc__ or "").split("\n")[0] in text
    for field_name, field in parameters(command):
        assert field.description, field_name
        assert " ".join(field.description.split()) in text, field_name


def test_commands_have_few_parameters() -> None:
    assert sum(len(list(parameters(command))) for command in commands().values()) <= MAX_PARAMETERS


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["render", "--memory-gb", "-1"], "--memory-gb: Input should be greater than 0"),
        (["render", "--device", "tpu"], "--device: 'tpu' is not auto, cpu, cuda"),
        (["render", "--allow-origin", "lab"], "--allow-origin: 'lab' is not a page's origin"),
        (["render", "--wheels"], "unrecognized arguments: --wheels; `tigas render --help` lists the options."),
        (["render", "--scene", "x"], "unrecognized arguments: --scene x"),
        (["shaper"], "--access is missing."),
        (["scene", "info"], "the following arguments are required: SCENE"),
        (["lab", "check", "--store", "x"], "unrecognized arguments: --store x"),
        (["lab", "exec", "client"], "COMMAND is missing."),
        (["lab", "wheels"], "tigas lab has no command 'wheels'; `tigas lab --help` lists them."),
        (["wheels"], "tigas has no command 'wheels'; `tigas --help` lists them."),
    ],
)
def test_a_wrong_command_line_is_a_sentence(arguments: list[str], sentence: str) -> None:
    run = tigas(*arguments)
    assert (run.exit_code, run.stdout) == (2, "")
    assert run.stderr.startswith(sentence)
    assert run.stderr.count("\n") == 1


HOSTILE = "a\x1b[2J\x1b]0;owned\x07b\rc\nd\x9be\u202ef\u2028g\x7fh\udc80i\u200bj"
SEEN = r"a\x1b[2J\x1b]0;owned\x07b\rc\nd\x9be\u202ef\u2028g\x7fh\udc80i\u200bj"


def test_what_would_act_or_hide_is_escaped_and_the_rest_stays() -> None:
    assert printable(HOSTILE) == SEEN
    assert printable("Übersicht: 20\u00a0Mbit/s ↔ 日本 😀 é") == "Übersicht: 20\u00a0Mbit/s ↔ 日本 😀 é"
    assert printable("one\ntwo\x1b", lines=True) == "one\ntwo\\x1b"


def test_a_log_has_one_line_for_each_message(capsys: pytest.CaptureFixture[str]) -> None:
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(LogFormatter("%(levelname)s %(message)s"))
    error = ValueError(HOSTILE)
    handler.handle(logging.LogRecord("x", logging.ERROR, "x.py", 1, "%s", (HOSTILE,), (ValueError, error, None)))
    first, *trace = stream.getvalue().splitlines()
    assert first == f"ERROR {SEEN}"
    assert "\x1b" not in "".join(trace)
    assert "ValueError" in "".join(trace)


def test_a_console_takes_names_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    console = make_console()
    console.file = io.StringIO()
    console.width = 300
    table = Table(title=f"[red]{HOSTILE} :smile:")
    table.add_column("[link=file:///etc/passwd]here")
    table.add_row("\x1b[31m[bold]name")
    console.print(table)
    console.print("\x1b[31m[bold]name", soft_wrap=True)
    told = console.file.getvalue()
    assert not set("\x1b\x07\r\x9b\u202e") & set(told)
    assert told.count(r"\x1b[31m[bold]name") == 2
    assert "[link=file:///etc/passwd]here" in told
    assert ":smile:" in told


def test_a_file_that_is_missing_is_named_in_plain_words() -> None:
    run = tigas("trace", "info", "no/such.csv")
    assert (run.exit_code, run.output) == (1, "no/such.csv: No such file or directory.\n")


def test_an_expected_error_cannot_paint_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="1"), report_errors(StartError):
        raise StartError(HOSTILE)
    assert SEEN in capsys.readouterr().err
