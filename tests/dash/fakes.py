"""A render service and a clock under the test's control."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from datetime import UTC, datetime

import numpy as np
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from tests.scenes import ALONE, scene
from tigas_common.errors import Overloaded, TigasError, UnknownScene
from tigas_common.web import EXCEPTION_HANDLERS, json_response, read_message
from tigas_common.wire.render import RenderRequest, Rung
from tigas_dash.clock import Clock


class FakeRender:
    """Answers at once, unless `gate` is closed; refuses with `error`, if there is one.

    Its frames are grey, with the camera's x as brightness.
    """

    def __init__(self) -> None:
        self.gate = asyncio.Event()
        self.gate.set()
        self.error: TigasError | None = None
        self.requests: list[RenderRequest] = []
        self.ladder: tuple[Rung, ...] | None = None
        """The scene's own."""
        self.cut = 0
        """Bytes that are missing at the end of a frame."""
        self.app = Starlette(
            routes=[
                Route("/config.json", self._config),
                Route("/scenes", self._scenes),
                Route("/render", self._render, methods=["POST"]),
            ],
            exception_handlers=EXCEPTION_HANDLERS,
        )

    async def _config(self, request: Request) -> Response:
        return json_response(ALONE)

    async def _scenes(self, request: Request) -> Response:
        known = scene(id="scene", ladder=self.ladder)
        return JSONResponse([known.model_dump()])

    async def _render(self, request: Request) -> Response:
        wanted = await read_message(request, RenderRequest)
        if wanted.scene != "scene":
            raise UnknownScene(f"There is no scene {wanted.scene!r}.")
        self.requests.append(wanted)
        if self.error is not None:
            raise self.error
        await self.gate.wait()
        body = grey(wanted.width, wanted.height, round(wanted.pose.position[0]) % 256)
        return Response(body[: len(body) - self.cut], media_type="video/x-raw; format=I420")


@dataclass(frozen=True)
class FakeClock(Clock):
    """Starts at 0, and advances only for waiting and work."""

    _wall: datetime = datetime(2026, 1, 31, 12, tzinfo=UTC)
    _monotonic: float = 0.0
    _spent: dict[str, float] = field(default_factory=lambda: {"waiting": 0.0, "working": 0.0})

    def now(self) -> float:
        return sum(self._spent.values())

    async def sleep_until(self, moment: float) -> None:
        self.wait(max(0.0, moment - self.now()))
        await asyncio.sleep(0)

    def wait(self, seconds: float) -> None:
        self._spent["waiting"] += seconds

    def work(self, seconds: float) -> None:
        self._spent["working"] += seconds


def grey(width: int, height: int, luma: int) -> bytes:
    """A uniform I420 frame."""
    return np.full(width * height, luma, np.uint8).tobytes() + b"\x80" * (width * height // 2)


BUSY = Overloaded("Too many requests are waiting; send fewer.")
