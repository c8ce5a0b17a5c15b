"""Static files, sent precompressed where available: `app.js.br` or `app.js.gz` for `app.js`."""

from __future__ import annotations

import mimetypes
import os
from pathlib import Path

from starlette.datastructures import Headers
from starlette.responses import FileResponse, Response
from starlette.staticfiles import NotModifiedResponse, StaticFiles
from starlette.types import Scope

ENCODINGS = {"br": ".br", "gzip": ".gz"}
"""Suffixes, the smallest first."""


class CompressedFiles(StaticFiles):
    """As its base, in the first encoding that there is and the client takes."""

    def file_response(
        self, full_path: str | os.PathLike[str], stat_result: os.stat_result, scope: Scope, status_code: int = 200
    ) -> Response:
        """The file or a compressed one; 304 if the client has just that."""
        headers = Headers(scope=scope)
        accepted = _accepted(headers.get("accept-encoding", ""))
        media_type = mimetypes.guess_type(full_path)[0]
        for encoding, suffix in ENCODINGS.items():
            compressed = Path(f"{os.fspath(full_path)}{suffix}")
            if encoding in accepted and compressed.is_file():
                response = FileResponse(
                    compressed,
                    status_code,
                    {"Content-Encoding": encoding},
                    media_type=media_type or "text/plain",
                    stat_result=compressed.stat(),
                )
                break
        else:
            response = FileResponse(full_path, status_code, stat_result=stat_result)
        response.headers["Vary"] = "Accept-Encoding"
        return NotModifiedResponse(response.headers) if self.is_not_modified(response.headers, headers) else response


def _accepted(header: str) -> set[str]:
    """Of an Accept-Encoding (RFC 9110, 12.5.3): which one the client prefers does not matter here."""
    parts = [part.replace(" ", "").partition(";") for part in header.lower().split(",")]
    return {coding for coding, _, weight in parts if weight.rstrip("0").rstrip(".") not in ("q=0", "q=")}
