"""Uploads over HTTP, with tus 1.0: creation, status and removal. `parts_route` accepts their contents."""

from __future__ import annotations

import asyncio
import base64
from pathlib import Path

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from tigas_common.address import client_network
from tigas_common.errors import InvalidRequest
from tigas_render.scenes.library_operations import check_free
from tigas_render.scenes.source import scene_id
from tigas_render.uploads.parts import open_uploads
from tigas_render.uploads.parts_route import PART_ROUTE, PATH, integer_header, tus_endpoint

EXTENSIONS = "creation,termination"
MAX_NAME_LENGTH = 255


@tus_endpoint
async def about(request: Request) -> Response:
    """Limits of uploads, as tus headers."""
    limit = open_uploads(request.app.state.settings).limit
    return Response(status_code=204, headers={"Tus-Extension": EXTENSIONS, "Tus-Max-Size": str(limit)})


@tus_endpoint
async def create(request: Request) -> Response:
    """Start uploading a scene's file (tus 1.0), named `filename` in Upload-Metadata."""
    uploads = open_uploads(request.app.state.settings)
    name, length = _file_name(request), integer_header(request, "upload-length")
    scene = scene_id(Path(name)) if Path(name).name == name else name
    await asyncio.to_thread(check_free, uploads.models, scene)
    address = client_network(request.client.host) if request.client else ""
    upload = await asyncio.to_thread(uploads.create, scene, length, address)
    # relative, so that it is correct behind a proxy that serves this at another path
    return Response(status_code=201, headers={"Location": f"uploads/{upload.id}"})


@tus_endpoint
async def progress(request: Request) -> Response:
    """Progress of an upload, as tus headers."""
    uploads = open_uploads(request.app.state.settings)
    upload = await asyncio.to_thread(uploads.get, request.path_params["id"])
    return Response(headers={"Upload-Offset": str(upload.offset), "Upload-Length": str(upload.length)})


@tus_endpoint
async def discard(request: Request) -> Response:
    """Discard an upload."""
    uploads = open_uploads(request.app.state.settings)
    await asyncio.to_thread(uploads.discard, request.path_params["id"])
    return Response(status_code=204)


def _file_name(request: Request) -> str:
    pairs = [pair.split() for pair in request.headers.get("upload-metadata", "").split(",")]
    try:
        [encoded] = [pair[1] for pair in pairs if len(pair) == 2 and pair[0] == "filename"]
        name = base64.b64decode(encoded, validate=True).decode()
    except ValueError:
        raise InvalidRequest("Upload-Metadata: a filename in base64 is required.") from None
    if not 0 < len(name) <= MAX_NAME_LENGTH:
        raise InvalidRequest(f"Upload-Metadata: a filename has 1 to {MAX_NAME_LENGTH} characters.")
    return name


UPLOAD_ROUTES = (
    Route(PATH, about, methods=["OPTIONS"]),
    Route(PATH, create, methods=["POST"]),
    Route(f"{PATH}/{{id}}", progress, methods=["HEAD"]),
    PART_ROUTE,
    Route(f"{PATH}/{{id}}", discard, methods=["DELETE"]),
)
"""The routes, for an application with RenderSettings as `state.settings`."""
