"""Uploads as a page makes them."""

from __future__ import annotations

import base64

import httpx

TUS = {"Tus-Resumable": "1.0.0"}


def begin(name: str, length: int) -> dict[str, str]:
    """The headers that begin an upload."""
    return {
        **TUS,
        "Upload-Length": str(length),
        "Upload-Metadata": f"filename {base64.b64encode(name.encode()).decode()}",
    }


def part(offset: int) -> dict[str, str]:
    """The headers of a part."""
    return {**TUS, "Upload-Offset": str(offset), "Content-Type": "application/offset+octet-stream"}


async def begun(client: httpx.AsyncClient, name: str, length: int, content: bytes = b"") -> str:
    """The address of an upload that was begun and has received this."""
    answer = await client.post("/uploads", headers=begin(name, length))
    assert answer.status_code == 201, answer.text
    at = "/" + answer.headers["location"]
    if content:
        sent = await client.patch(at, headers=part(0), content=content)
        assert sent.status_code == 204, sent.text
    return at


async def upload(client: httpx.AsyncClient, name: str, content: bytes) -> httpx.Response:
    """A whole file, and its outcome."""
    return await client.post(f"{await begun(client, name, len(content), content)}/scene")
