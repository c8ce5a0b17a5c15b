"""The web client's files, sent precompressed where available: `app.js.br` or `app.js.gz` for `app.js`."""

from __future__ import annotations

import mimetypes
import os
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.staticfiles import NotModifiedResponse, StaticFiles
from starlette.types import Scope

from tigas_common.web import WORKER_POLICY, page_policy
from tigas_common.wire.render import ServerConfig

ENCODINGS = {"br": ".br", "gzip": ".gz"}
"""File suffixes by encoding, in order of preference: Brotli files are smaller."""


class Page(StaticFiles):
    """Serves hashed assets to be cached forever, and the page itself to be revalidated."""

    def __init__(self, directory: Path, config: Callable[[Request], ServerConfig]) -> None:
        """config: returns the page's configuration for a request."""
        super().__init__(directory=directory, html=True)
        self._config = config

    async def get_response(self, path: str, scope: Scope) -> Response:
        response = await super().get_response(path, scope)
        hashed = path.startswith("assets/")
        response.headers["Cache-Control"] = "max-age=31536000, immutable" if hashed else "no-cache"
        policy = WORKER_POLICY if hashed else _content_security_policy(self._config(Request(scope)))
        response.headers["Content-Security-Policy"] = policy
        return response

    def file_response(
        self, full_path: str | os.PathLike[str], stat_result: os.stat_result, scope: Scope, status_code: int = 200
    ) -> Response:
        """The file in the first encoding that exists and the client accepts; 304 if the client already has it."""
        headers = Headers(scope=scope)
        accepted = _accepted_encodings(headers.get("accept-encoding", ""))
        for encoding, suffix in ENCODINGS.items():
            compressed = Path(f"{os.fspath(full_path)}{suffix}")
            if encoding in accepted and compressed.is_file():
                response = FileResponse(
                    compressed,
                    status_code,
                    {"Content-Encoding": encoding},
                    mimetypes.guess_type(full_path)[0] or "text/plain",
                    stat_result=compressed.stat(),
                )
                break
        else:
            response = FileResponse(full_path, status_code, stat_result=stat_result)
        response.headers["Vary"] = "Accept-Encoding"
        return NotModifiedResponse(response.headers) if self.is_not_modified(response.headers, headers) else response


def _accepted_encodings(header: str) -> set[str]:
    """The codings that an Accept-Encoding header allows (RFC 9110, 12.5.3), ignoring the order of preference."""
    parts = [part.replace(" ", "").partition(";") for part in header.lower().split(",")]
    return {coding for coding, _, weight in parts if weight.rstrip("0").rstrip(".") not in ("q=0", "q=")}


def _content_security_policy(config: ServerConfig) -> str:
    """The page's Content-Security-Policy: its own origin, and connections to the services' hosts on any port."""
    urls = [urlsplit(url) for url in (*config.services.values(), config.webtransport_url) if url]
    # The syntax of host sources has no IPv6 addresses, so only the scheme can be restricted.
    sources = (f"{url.scheme}:" if "[" in url.netloc else f"{url.scheme}://{url.hostname}:*" for url in urls)
    return page_policy(set(sources))
