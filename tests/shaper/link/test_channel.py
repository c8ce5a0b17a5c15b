"""Exchanges with a long-running tool: a fake that answers, complains and exits on demand."""

from __future__ import annotations

import sys
from collections.abc import AsyncIterator

import pytest

from tigas_shaper.link.channel import Channel, CommandError, attempt, run

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
