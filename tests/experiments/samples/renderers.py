"""Fake render services, and runs with samples of their frames."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx

from tests.experiments.made_up import png, sampled, write_run
from tests.scenes import ALONE, scene
from tigas_common.render_requests import RenderClient
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.samples import JPEG, write_sample_file, write_samples
from tigas_experiments.wire.recording import Sample

SHA256 = "a" * 64


def picture(x: float, width: int, height: int, form: str, shade: int = 0) -> bytes:
    """A view that encodes the camera's position; another renderer has another shade."""
    return png(int(x) * 20 % 256, width, height, blue=shade, form=form)


class FakeRenderer:
    """Answers and records each request; `refuse` may answer instead."""

    def __init__(
        self,
        shade: int = 0,
        refuse: Callable[[dict[str, Any]], httpx.Response | None] = lambda wanted: None,
        file_sha256: str | None = SHA256,
    ) -> None:
        self.asked: list[tuple[int, str]] = []
        """Sequence numbers, and formats."""
        self._shade, self._refuse = shade, refuse
        self._scene = scene(file_sha256=file_sha256)

    async def __call__(self, request: httpx.Request) -> httpx.Response:
        if request.url.path == "/config.json":
            return httpx.Response(200, content=ALONE.model_dump_json())
        if request.url.path.startswith("/scenes/"):
            return httpx.Response(200, content=self._scene.model_dump_json())
        wanted = json.loads(request.content)
        if (refused := self._refuse(wanted)) is not None:
            return refused
        self.asked.append((wanted["seq"], wanted["format"]))
        full = "profile" not in wanted
        width, height = (wanted["width"], wanted["height"]) if full else (wanted["width"] // 2, wanted["height"] // 2)
        return httpx.Response(
            200, content=picture(wanted["position"][0], width, height, wanted["format"].upper(), self._shade)
        )

    @asynccontextmanager
    async def client(self) -> AsyncIterator[RenderClient]:
        """As the code under test uses it."""
        async with httpx.AsyncClient(base_url="http://render", transport=httpx.MockTransport(self)) as http:
            yield patient_client(http)


def patient_client(http: httpx.AsyncClient) -> RenderClient:
    return RenderClient(http, "The render service at http://render", patient=True)


def sampled_run(folder: Path, numbers: Sequence[int], **changes: Any) -> list[Sample]:
    """A run with FakeRenderer's frames as samples; `changes` apply to its configuration."""
    write_run(folder, **changes)
    record = StoredRun(folder).record
    (folder / "run.json").write_text(record.model_copy(update={"scene_sha256": SHA256}).model_dump_json())
    samples = [sampled(seq, at=10.0 * seq, width=32, height=18) for seq in numbers]
    for each in samples:
        write_sample_file(folder, each.seq, JPEG, picture(each.seq, 32, 18, "JPEG"))
    write_samples(folder, samples)
    return samples


def problem(status: int, detail: str, **headers: str) -> httpx.Response:
    told = {"type": "tigas:x", "title": "No", "status": status, "detail": detail}
    return httpx.Response(status, json=told, headers=headers)
