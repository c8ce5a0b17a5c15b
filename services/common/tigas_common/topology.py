"""Ports of all services, and the settings through which the page finds them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal
from urllib.parse import urlsplit

from tigas_common.address import Address, bracket_host, is_loopback

ServiceName = Literal["dash", "shaper", "store"]
"""Names that the page uses for the services other than the render service."""
SERVICES_PATH = "/services"
"""Path prefix of requests that the render service proxies, followed by a service's name."""


@dataclass(frozen=True, slots=True)
class Port:
    """A service's port: the same on every host and on the shaper that forwards to it."""

    protocol: Literal["tcp", "udp"]
    number: int

    @property
    def loopback(self) -> Address:
        """The port on this machine only."""
        return Address("127.0.0.1", self.number)

    @property
    def all_interfaces(self) -> Address:
        """The port on every address of the host."""
        return Address("0.0.0.0", self.number)


PAGE = Port("tcp", 8080)
"""The render service's page and API."""
PAGE_HTTPS = Port("tcp", 8443)
"""The render service's page and API over HTTPS, for other devices."""
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
"""Origins of the page on this machine, as browsers send them."""
SERVICES_VARIABLE = "TIGAS_RENDER_SERVICES"
"""The environment variable that holds the render service's setting `services`."""


UPSTREAMS_VARIABLE = "TIGAS_RENDER_UPSTREAMS"
"""The environment variable that holds the render service's setting `upstreams`."""


def services_json(*, shaped: bool, store: bool = True) -> str:
    """The render service's setting `services` as JSON: the other services, on the page's own host."""
    services = {"dash": DASH, **({"shaper": SHAPER} if shaped else {}), **({"store": STORE} if store else {})}
    return json.dumps({name: f":{port.number}" for name, port in services.items()})


def upstreams_json(*, shaper_host: str | None = None, store: bool = True) -> str:
    """Its setting `upstreams` as JSON: packager and store on the same machine, and the shaper on its host."""
    addresses = {"dash": DASH.loopback, **({"store": STORE.loopback} if store else {})}
    if shaper_host is not None:
        addresses["shaper"] = Address(shaper_host, SHAPER.number)
    return json.dumps({name: f"http://{address}" for name, address in addresses.items()})


def resolve_service_url(url: str, host: str) -> str:
    """A service's URL for a page opened under `host`; a bare `:PORT` is a port of that host."""
    return f"http://{bracket_host(host)}{url}" if url.startswith(":") else url


def reachable_services(page: str, services: Mapping[str, str], upstreams: Mapping[ServiceName, str]) -> dict[str, str]:
    """Each service's URL for a page with this origin: the service's own if the page can reach it, else a proxied path.

    services: URLs for `resolve_service_url`. upstreams: URLs of proxied services, perhaps unreachable elsewhere.
    """
    own = urlsplit(page)
    host = own.hostname or "localhost"

    def direct(name: str, url: str) -> bool:
        upstream = upstreams.get(name)  # type: ignore[call-overload]
        if upstream is None:
            return True
        if own.scheme == "https" and not url.startswith("https:"):
            return False
        elsewhere = is_loopback(urlsplit(upstream).hostname or "") and not is_loopback(host)
        return not (url.startswith(":") and elsewhere)

    found = {name: resolve_service_url(url, host) for name, url in services.items() if direct(name, url)}
    return {name: f"{page}{SERVICES_PATH}/{name}" for name in upstreams} | found
