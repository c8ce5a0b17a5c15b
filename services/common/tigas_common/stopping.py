"""Answers to requests that are cut off by a shutdown."""

from __future__ import annotations

import asyncio

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tigas_common.errors import Overloaded, problem
from tigas_common.web import problem_response

STOPPING = "The service is stopping."


def told_when_stopping(app: ASGIApp) -> ASGIApp:
    """An application that answers cancelled requests with 503, in place of uvicorn's 500."""

    async def told(scope: Scope, receive: Receive, send: Send) -> None:
        started = False

        async def noting(message: Message) -> None:
            nonlocal started
            started = True
            await send(message)

        try:
            await app(scope, receive, noting)
        except asyncio.CancelledError:
            if started or scope["type"] != "http":
                raise
            await problem_response(problem(Overloaded(STOPPING)))(scope, receive, send)

    return told
