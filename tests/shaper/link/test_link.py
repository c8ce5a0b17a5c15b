"""The shaped link: commands of tc and nft, sizes, and dialogues with tools."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import AsyncIterator
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import pytest

from tigas_common.address import Address
from tigas_common.errors import StartError
from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.link.commands import Channel, CommandError, Interface, run, try_run
from tigas_shaper.link.delay import NetemStage
from tigas_shaper.link.gateway import Forward, make_rules
from tigas_shaper.link.link import MIN_QUEUE, Direction, queue_bytes, queue_line, rate_line
from tigas_shaper.main import check_ports

pytestmark = pytest.mark.anyio

DEVICE = Interface("tigas-down")
ROOT = {"kind": "htb", "handle": "2:", "root": True}
CLSACT = {"kind": "clsact", "handle": "ffff:", "parent": "ffff:fff1"}
REMOVED = pytest.raises(CommandError, match=r"^another program has removed the delay stage of eth0\.$")


class Recorder:
    """In place of tc and of the delay stage."""

    def __init__(self) -> None:
        self._lines: list[str] = []

    def write(self, *lines: str) -> None:
        self._lines += lines

    def set(self, state: LinkSetting, *, blocked: bool) -> None:
        self.write(f"delay {state.delay_ms:g} {state.jitter_ms:g} {state.loss_pct:g} {blocked}")

    def take(self) -> list[str]:
        lines, self._lines = self._lines, []
        return lines


@pytest.fixture
def tc() -> Recorder:
    return Recorder()


@pytest.fixture
def direction(tc: Recorder) -> Direction:
    return Direction(tc, DEVICE, Interface("lo"), tc, queue_ms=150)  # type: ignore[arg-type]


def test_a_queue_takes_its_time_to_drain() -> None:
    assert queue_bytes(20_000, 150) == 375_000
    assert queue_bytes(10, 150) == MIN_QUEUE
    assert queue_bytes(1e8, 10_000) == 2**32 - 1, "tc takes no more"


@pytest.mark.parametrize(
    ("rate", "bits", "burst"),
    [(20_000, 20_000_000, 3028), (1e6, 10**9, 125_000), (1, 50_000, 3028), (0.5, 50_000, 3028)],
)
def test_rates_are_whole_numbers_and_never_too_low_to_recover_from(rate: float, bits: int, burst: int) -> None:
    line = rate_line("change", DEVICE, rate)
    assert f"rate {bits}bit burst {burst}b cburst {burst}b" in line
    assert line.startswith("class change dev tigas-down ")


def test_only_changes_are_sent(tc: Recorder, direction: Direction) -> None:
    state = LinkSetting(down_kbps=20_000, up_kbps=1_000, delay_ms=5)
    direction.shape(state, state.down_kbps, 10_000)
    assert tc.take() == [
        "delay 5 0 0 False",
        rate_line("change", DEVICE, 20_000),
        queue_line("change", DEVICE, 187_500, 1e7),
    ]
    direction.shape(state, state.down_kbps, None)
    assert tc.take() == []
    direction.shape(state, 8_000, 10_000)
    assert tc.take() == [rate_line("change", DEVICE, 8_000)]


def test_an_outage_slows_the_leaf_and_keeps_its_queue_and_its_rate(tc: Recorder, direction: Direction) -> None:
    on, off = LinkSetting(1_000, 1_000), LinkSetting(0, 0)
    direction.shape(on, 1_000, 1_000)
    tc.take()
    direction.shape(off, 0, None)
    delay, queue = tc.take()
    assert delay == "delay 0 0 0 True"
    assert queue.endswith("tbf rate 50kbit burst 3028b limit 18750b")
    direction.shape(on, 1_000, None)
    delay, queue = tc.take()
    assert delay == "delay 0 0 0 False"
    assert queue.endswith("tbf rate 10000000kbit burst 3028b limit 18750b")


def test_netem_gets_microseconds_keeps_the_order_and_loses_everything_in_an_outage(tc: Recorder) -> None:
    stage = NetemStage(tc, Interface("eth0"))  # type: ignore[arg-type]
    state = LinkSetting(1, 1, delay_ms=12.5, jitter_ms=0.25, loss_pct=1.5)
    stage.set(state, blocked=False)
    stage.set(state, blocked=True)
    change = "qdisc change dev eth0 parent 2:1 handle 20: netem limit 100000 delay 12500us 250us loss {}% rate 100gbit"
    assert tc.take() == [change.format("1.5000"), change.format("100.0000")]


class Answering:
    """In place of tc, with one answer."""

    def __init__(self, answer: str) -> None:
        self._answer = answer

    async def ask(self, _line: str, _begin: str) -> str:
        return self._answer


@pytest.mark.parametrize(
    ("qdiscs", "refused"),
    [
        ([ROOT, {"kind": "netem", "handle": "20:", "parent": "2:1"}, CLSACT], nullcontext()),
        ([ROOT, CLSACT], REMOVED),
        ([{"kind": "netem", "handle": "8001:", "root": True}, CLSACT], REMOVED),
        ([], REMOVED),
    ],
)
async def test_a_netem_that_another_program_has_removed_or_replaced_is_noticed(
    qdiscs: list[dict[str, Any]], refused: AbstractContextManager[Any]
) -> None:
    stage = NetemStage(Answering(json.dumps(qdiscs)), Interface("eth0"))  # type: ignore[arg-type]
    with refused:
        await stage.check()


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
    with pytest.raises(CommandError, match="exited"):
        await channel.ask("show", "[")
    with pytest.raises(CommandError, match="exited"):
        channel.write("change")


@pytest.mark.parametrize("line", ["", "two\nlines", "nul\0", "tab\t", "é"])
async def test_only_single_lines_of_plain_text_are_sent(channel: Channel, line: str) -> None:
    with pytest.raises(CommandError, match="is not one line of plain text"):
        channel.write("change", line)
    assert await channel.ask("show", "[") == "[1, 2]"


async def test_commands_that_run_once() -> None:
    assert await try_run(sys.executable, "-c", "pass")
    assert not await try_run(sys.executable, "-c", "raise SystemExit(3)")
    with pytest.raises(CommandError, match=r"^bad luck$"):
        await run(sys.executable, "-c", "import sys; sys.exit('bad luck')")


@pytest.mark.parametrize("name", ["", "a b", "eth0;reboot", "-h", "x\ny", "a/b", "a" * 16, '"', "é"])
def test_what_is_no_interfaces_name_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="is not the name of a network interface"):
        Interface(name)


def test_an_interfaces_number_tells_whether_it_exists() -> None:
    assert Interface("lo").number
    assert Interface("nope0").number is None


def test_a_forward_reads_its_protocol_ports_and_host() -> None:
    forward = Forward.parse("udp:4433=192.0.2.7:443")
    assert (forward.protocol, forward.port, str(forward.host), forward.host_port) == ("udp", 4433, "192.0.2.7", 443)
    assert str(Forward.parse("tcp:80=localhost:8080").host) == "127.0.0.1"


@pytest.mark.parametrize(
    "text",
    ["", "8080", "tcp:8080", "sctp:1=a:2", "tcp:0=a:1", "tcp:1=a:65536", "tcp:x=a:1", "tcp:²=a:1", "tcp:1=:2",
     "tcp:1=a b; drop:2", "udp:1=nowhere.invalid:2", "udp:1=a..b:2", f"udp:1={'a' * 70}:2"],
)  # fmt: skip
def test_what_is_no_forward_is_refused_with_a_sentence(text: str) -> None:
    with pytest.raises(ValueError, match=r"is not tcp:PORT=HOST:PORT|has no IPv4 address"):
        Forward.parse(text)


@pytest.mark.parametrize(
    ("forwards", "api", "problem"),
    [
        (["tcp:80=192.0.2.1:1", "tcp:80=192.0.2.2:2"], "127.0.0.1:8090", "80 (tcp) is forwarded twice"),
        (["tcp:8090=192.0.2.1:1"], "0.0.0.0:8090", "8090 cannot be forwarded"),
        (["tcp:80=192.0.2.1:1", "udp:80=192.0.2.1:1"], "0.0.0.0:8090", None),
        (["tcp:8090=192.0.2.1:1"], "127.0.0.1:8090", None),
    ],
)
def test_ports_that_clients_could_not_reach_are_refused(forwards: list[str], api: str, problem: str | None) -> None:
    with pytest.raises(StartError, match=re.escape(problem)) if problem else nullcontext():
        check_ports([Forward.parse(text) for text in forwards], Address.parse(api))


def test_the_gate_is_closed_first_and_only_forwarded_packets_pass() -> None:
    lines = make_rules(Interface("a0"), Interface("s0"), [Forward.parse("tcp:80=192.0.2.1:8080")])
    assert lines[0].endswith("{ flags owner; }")
    assert lines.index("add rule ip tigas_shaper gate drop") < min(
        index for index, line in enumerate(lines) if "hook" in line
    )
    crossing = [line for line in lines if " crossing " in line and "add rule" in line]
    assert [line[-9:] for line in crossing[:2]] == ["jump gate"] * 2
    assert all("ct status dnat" in line for line in crossing if "accept" in line)
    assert [line[-4:] for line in crossing[-2:]] == ["drop", "drop"]
