"""Every command that `make help` names has a rule behind it."""

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def make(*arguments: str) -> str:
    return subprocess.run(["make", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_every_command_that_help_names_runs_something() -> None:
    commands = re.findall(r"^make ([\w-]+)", make("help"), re.MULTILINE)
    assert {"demo", "test", "bench-load", "bench-gpu"} <= set(commands)
    idle = [command for command in commands if "Nothing to be done" in make("--always-make", "--dry-run", command)]
    assert not idle
