"""Every command that `make help` lists has a rule, and installation shows its progress."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

SLOW_PIP = """#!/bin/sh
echo "Collecting uv"
read -r answer
echo "no room on the disk" >&2
exit 1
"""
PYTHON = f"""#!/bin/sh
[ "$2" = venv ] || exit 0
mkdir -p .venv/bin
cat >.venv/bin/pip <<'PIP'
{SLOW_PIP}PIP
chmod +x .venv/bin/pip
ln -s "$0" .venv/bin/python
"""
"""An environment in which pip waits for input and then fails."""


def make(*arguments: str) -> str:
    return subprocess.run(["make", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_every_command_that_help_names_runs_something() -> None:
    commands = re.findall(r"^make ([\w-]+)", make("help"), re.MULTILINE)
    assert {"demo", "test", "bench-load", "bench-gpu"} <= set(commands)
    idle = [command for command in commands if "Nothing to be done" in make("--always-make", "--dry-run", command)]
    assert not idle


def test_what_pip_says_is_seen_at_once_in_a_pipe_and_so_is_its_failure(tmp_path: Path) -> None:
    for name in ("Makefile", "pyproject.toml", "uv.lock"):
        shutil.copy(ROOT / name, tmp_path / name)
    python = tmp_path / "python"
    python.write_text(PYTHON)
    python.chmod(0o755)
    command = ["make", f"PYTHON={python}", ".venv/.ready"]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, cwd=tmp_path, stdin=pipe, stdout=pipe, stderr=subprocess.STDOUT, text=True
    ) as install:
        assert install.stdout is not None
        assert "Collecting uv\n" in iter(install.stdout.readline, ""), "pip ended without output"
        said, _ = install.communicate("go on\n")
    assert install.returncode != 0
    assert "no room on the disk" in said
    assert not (tmp_path / ".venv/.demo").exists()


TIGAS = """#!/bin/sh
echo "tigas $*"
case "$1 $2" in
"lab check") exit ${CHECKED};;
esac
"""
"""A `tigas` that prints its arguments, with a shaped link or without."""


def demo(folder: Path, arguments: str, checked: int) -> tuple[int, list[str]]:
    """The exit status of `make demo`, and the commands that it runs. checked: the status of `tigas lab check`."""
    shutil.copy(ROOT / "Makefile", folder)
    program = folder / "bin/tigas"
    program.parent.mkdir()
    program.write_text(TIGAS)
    program.chmod(0o755)
    done = subprocess.run(
        ["make", "--silent", "demo", "MAKE=true", "VENV=bin", f"ARGS={arguments}"],
        cwd=folder,
        env={**os.environ, "CHECKED": str(checked)},
        capture_output=True,
        text=True,
    )
    return done.returncode, [line for line in done.stdout.splitlines() if line.startswith("tigas ")]


@pytest.mark.parametrize(
    ("arguments", "checked", "status", "commands"),
    [
        ("", 0, 0, ["tigas lab check", "tigas lab up"]),
        ("", 1, 0, ["tigas lab check", "tigas demo --"]),
        (
            "--https localhost:8443",
            0,
            0,
            ["tigas lab check --https localhost:8443", "tigas lab up --https localhost:8443"],
        ),
        ("--https wrong", 2, 2, ["tigas lab check --https wrong"]),
        ("--lan", 0, 0, ["tigas demo -- --lan"]),
    ],
)
def test_the_demo_is_behind_the_shaped_link_if_it_can_be(
    arguments: str, checked: int, status: int, commands: list[str], tmp_path: Path
) -> None:
    assert demo(tmp_path, arguments, checked) == (status, commands)


def test_pytorch_is_installed_by_the_version_of_the_lock_and_without_cuda() -> None:
    commands = make("--always-make", "--dry-run", ".venv/.lab")
    assert re.search(r"pip install .* torch==\d+\.\d+\.\d+$", commands, re.MULTILINE)
    without = set(re.findall(r"--no-install-package (\S+)", commands))
    assert {"torch", "triton", "cuda-toolkit", "nvidia-cublas", "nvidia-cudnn-cu13"} <= without
    assert not {name for name in without if not name.startswith(("torch", "triton", "cuda-", "nvidia-"))}
