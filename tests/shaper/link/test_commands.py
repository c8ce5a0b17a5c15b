"""Names in commands, and exchanges with a fake tool that answers, complains and exits on demand."""

from __future__ import annotations

import sys
from collections.abc import AsyncIterator

import pytest

from tigas_shaper.link.commands import Channel, CommandError, Interface, attempt, run

pytestmark = pytest.mark.anyio
TOOL = """
import sys
for number, line in enumerate(sys.stdin, 1):
    word = line.split()[0]
    if word == "show":
        print("[1, 2]", flush=True)
    elif word == "warn":
        print("Warning: that is a lot.", file=sys.stderr, flush=True)
    elif word == "die":
        sys.exit(1)
    elif word != "change":
        print(f"Unknown word {word}", file=sys.stderr, flush=True)
        print(f"Command failed -:{number}", file=sys.stderr, flush=True)
"""


@pytest.fixture
async def channel() -> AsyncIterator[Channel]:
    async with Channel.open((sys.executable, "-c", TOOL), "Command failed") as channel:
        yield channel


async def test_changes_need_no_answer_and_questions_get_theirs(channel: Channel) -> None:
    channel.write("change one", "change two", "warn")
    assert await channel.ask("show", "[") == "[1, 2]"
    assert await channel.ask("show", "[") == "[1, 2]"


async def test_a_refused_line_is_found_by_the_next_question(channel: Channel) -> None:
    channel.write("change one", "nonsense")
    with pytest.raises(CommandError, match="Unknown word nonsense Command failed -:2"):
        await channel.ask("show", "[")


async def test_a_tool_that_dies_is_noticed(channel: Channel) -> None:
    channel.write("die")
    with pytest.raises(CommandError, match="has ended"):
        await channel.ask("show", "[")
    with pytest.raises(CommandError, match="has ended"):
        channel.write("change")


@pytest.mark.parametrize("line", ["", "two\nlines", "nul\0", "tab\t", "é"])
async def test_only_single_lines_of_plain_text_are_sent(channel: Channel, line: str) -> None:
    with pytest.raises(CommandError, match="is not one line of plain text"):
        channel.write("change", line)
    assert await channel.ask("show", "[") == "[1, 2]"


async def test_commands_that_run_once() -> None:
    assert await attempt(sys.executable, "-c", "pass")
    assert not await attempt(sys.executable, "-c", "raise SystemExit(3)")
    with pytest.raises(CommandError, match=r"^bad luck$"):
        await run(sys.executable, "-c", "import sys; sys.exit('bad luck')")


@pytest.mark.parametrize("name", ["", "a b", "eth0;reboot", "-h", "x\ny", "a/b", "a" * 16, '"', "é"])
def test_what_is_no_interfaces_name_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="is not the name of a network interface"):
        Interface(name)


def test_an_interfaces_number_tells_whether_it_exists() -> None:
    assert Interface("lo").number
    assert Interface("nope0").number is None
