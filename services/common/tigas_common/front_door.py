"""Index at `/` of a service without a page, for visitors of its printed address: its routes."""

from __future__ import annotations

import inspect
from importlib.metadata import version

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from tigas_common.described import TEXT, described
from tigas_common.web import NO_STORE


def front_door(name: str) -> Route:
    """The route that lists the others, each with the first line of its docstring."""

    @described(gives=(TEXT,))
    async def listing(request: Request) -> Response:
        """List of this service's routes."""
        lines = [f"{name}, TIGAS {version('tigas')}", ""]
        for route in request.app.routes:
            if isinstance(route, Route) and route.path != "/":
                methods = "/".join(sorted((route.methods or set()) - {"HEAD"}))
                summary = (inspect.getdoc(route.endpoint) or "").partition("\n")[0]
                lines.append(f"{methods:7}{route.path_format}\n       {summary}")
        return PlainTextResponse("\n".join(lines) + "\n", headers=NO_STORE)

    return Route("/", listing)
