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


async def upload(client: httpx.AsyncClient, name: str, content: bytes) -> httpx.Response:
    """A whole file, and its outcome."""
    begun = await client.post("/uploads", headers=begin(name, len(content)))
    assert begun.status_code == 201, begun.text
    at = "/" + begun.headers["location"]
    sent = await client.patch(at, headers=part(0), content=content)
    assert sent.status_code == 204, sent.text
    return await client.post(f"{at}/scene")
