"""Who listens where: every service's port, and what tells the page where the others are."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Literal

from tigas_common.address import Address, bracketed


@dataclass(frozen=True, slots=True)
class Port:
    """A service's port: the same on every host that it runs on, and on the shaper that forwards to it."""

    protocol: Literal["tcp", "udp"]
    number: int

    @property
    def loopback(self) -> Address:
        """On this machine alone."""
        return Address("127.0.0.1", self.number)

    @property
    def everywhere(self) -> Address:
        """On every address of the host."""
        return Address("0.0.0.0", self.number)


PAGE = Port("tcp", 8080)
"""The render service's page and API."""
PAGE_HTTPS = Port("tcp", 8443)
"""The same for other devices."""
WEBTRANSPORT = Port("udp", 4433)
"""The render service's HTTP/3."""
DASH = Port("tcp", 8081)
"""The packager's streams and API."""
WEBRTC = Port("udp", DASH.number)
"""The packager's streams over WebRTC."""
SHAPER = Port("tcp", 8090)
"""The shaper's API."""
STORE = Port("tcp", 8091)
"""The API of the experiments' store."""

PAGE_ORIGINS = (f"http://localhost:{PAGE.number}", f"http://127.0.0.1:{PAGE.number}")
"""The page on this machine, as browsers name it in `Origin`."""
SERVICES_VARIABLE = "TIGAS_RENDER_SERVICES"
"""The environment variable that holds the render service's setting `services`."""


def page_services(*, shaped: bool) -> str:
    """The render service's setting `services` in JSON: the others on the page's own host, the shaper if `shaped`."""
    services = {"dash": DASH, **({"shaper": SHAPER} if shaped else {}), "store": STORE}
    return json.dumps({name: f":{port.number}" for name, port in services.items()})


def fitted(url: str, host: str) -> str:
    """A service's URL, as a page is told it that was opened under `host`; `:PORT` alone is a port of that host."""
    return f"http://{bracketed(host)}{url}" if url.startswith(":") else url
