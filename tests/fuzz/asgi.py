"""Speaks ASGI to an application as its server does, with requests that no client library would send."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterable, Iterator, Sequence
from contextlib import AbstractAsyncContextManager, contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar
from urllib.parse import unquote

from starlette.types import ASGIApp, Message

from tests.fuzz.fuzzers import assert_sentence
from tigas_common.wire.render import Problem

LONGEST_S = 30
"""No answer takes longer, even on a busy machine."""
HOST = (b"host", b"localhost:8080")
STARLETTES_OWN = (b"Disallowed CORS", b"Malformed range header")
"""Beginnings of refusals that are no problem+json."""
T = TypeVar("T")


@dataclass
class Answer:
    """The application's answer."""

    method: str = ""
    status: int = 0
    headers: dict[bytes, bytes] = field(default_factory=dict)
    body: bytes = b""


@contextmanager
def opened(context: AbstractAsyncContextManager[T]) -> Iterator[tuple[T, Callable[[Coroutine[Any, Any, Any]], Any]]]:
    """An asynchronous context on a separate loop, and a function that runs a coroutine there."""
    with asyncio.Runner() as runner:
        value = runner.run(_entered(context))
        try:
            yield value, runner.run
        finally:
            runner.run(_left(context))


async def ask(
    app: ASGIApp,
    method: str,
    path: str,
    *,
    chunks: Sequence[bytes] = (b"",),
    headers: Iterable[tuple[bytes, bytes]] = (HOST,),
) -> Answer:
    """One request, its body in pieces; the target is a path, percent-encoded or not, with a query."""
    raw_path, _, query = path.partition("?")
    scope = {
        "type": "http",
        "asgi": {"version": "3.0", "spec_version": "2.3"},
        "http_version": "1.1",
        "method": method,
        "scheme": "http",
        "path": unquote(raw_path),
        "raw_path": raw_path.encode("utf-8", "replace"),
        "query_string": query.encode("utf-8", "replace"),
        "root_path": "",
        "headers": list(headers),
        "client": ("192.0.2.1", 1000),
        "server": ("127.0.0.1", 8080),
    }
    messages: list[Message] = [
        {"type": "http.request", "body": chunk, "more_body": number < len(chunks)}
        for number, chunk in enumerate(chunks, 1)
    ]
    done = asyncio.Event()
    answer = Answer(method)

    async def receive() -> Message:
        if messages:
            return messages.pop(0)
        await done.wait()
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        if message["type"] == "http.response.start":
            answer.status, answer.headers = message["status"], dict(message["headers"])
        else:
            answer.body += message.get("body", b"")
            if not message.get("more_body", False):
                done.set()

    async with asyncio.timeout(LONGEST_S):
        await app(scope, receive, send)
    return answer


def assert_answered(answer: Answer, *busy: str) -> None:
    """Success, or one sentence on the client's mistake; `busy` lists acceptable problems of the server, such as
    `overloaded`.
    """
    assert answer.status, "no answer"
    if answer.status < 400 or answer.body.startswith(STARLETTES_OWN) or (answer.method == "HEAD" and not answer.body):
        return
    assert answer.headers.get(b"content-type") == b"application/problem+json", answer
    problem = Problem.model_validate_json(answer.body)
    assert problem.status == answer.status
    assert answer.status < 500 or problem.type.removeprefix("tigas:") in busy, problem
    assert_sentence(problem.detail)


async def _entered(context: AbstractAsyncContextManager[T]) -> T:
    return await context.__aenter__()


async def _left(context: AbstractAsyncContextManager[Any]) -> None:
    await context.__aexit__(None, None, None)
