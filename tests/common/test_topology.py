"""compose.yaml and the images, which cannot import the topology, agree with it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from tigas_common.topology import (
    DASH,
    PAGE,
    PAGE_HTTPS,
    SHAPER,
    STORE,
    WEBRTC,
    WEBTRANSPORT,
    Port,
    ServiceName,
    reachable_services,
    services_json,
    upstreams_json,
)

ROOT = Path(__file__).parents[2]
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]
BEHIND_THE_SHAPER = {
    PAGE: "render",
    PAGE_HTTPS: "render",
    WEBTRANSPORT: "render",
    DASH: "dash-packager",
    WEBRTC: "dash-packager",
    STORE: "store",
}


def address(service: str) -> str:
    """A service's address in the network that the shaper forwards to."""
    found: str = COMPOSE[service]["networks"]["services"]["ipv4_address"]
    return found


def test_compose_forwards_every_service() -> None:
    forwards = json.loads(COMPOSE["shaper"]["environment"]["TIGAS_SHAPER_FORWARD"])
    expected = {f"{p.protocol}:{p.number}={address(name)}:{p.number}" for p, name in BEHIND_THE_SHAPER.items()}
    assert set(forwards) == expected


def test_compose_publishes_ports_of_the_shaper_alone_and_its_api_on_this_host_only() -> None:
    published = {f"{p.number}:{p.number}{'/udp' if p.protocol == 'udp' else ''}" for p in BEHIND_THE_SHAPER}
    assert set(COMPOSE["shaper"]["ports"]) == published | {f"{SHAPER.loopback}:{SHAPER.number}"}
    started = {name: service for name, service in COMPOSE.items() if "profiles" not in service}
    assert {name for name, service in started.items() if "ports" in service} == {"shaper"}


def test_compose_tells_the_services_where_the_others_are() -> None:
    assert COMPOSE["render"]["environment"]["TIGAS_RENDER_SERVICES"] == services_json(shaped=True)
    handed_on = {
        "dash": f"http://{address('dash-packager')}:{DASH.number}",
        "store": f"http://{address('store')}:{STORE.number}",
    }
    assert json.loads(COMPOSE["render"]["environment"]["TIGAS_RENDER_UPSTREAMS"]) == handed_on
    assert COMPOSE["dash-packager"]["environment"]["TIGAS_DASH_RENDER"] == f"http://{address('render')}:{PAGE.number}"


HERE: dict[ServiceName, str] = {"dash": "http://127.0.0.1:8081"}
NEAR: dict[ServiceName, str] = {"dash": "http://172.30.2.11:8081"}


@pytest.mark.parametrize(
    ("page", "services", "upstreams", "url"),
    [
        ("http://localhost:8080", {"dash": ":8081"}, HERE, "http://localhost:8081"),
        ("http://[::1]:8080", {"dash": ":8081"}, HERE, "http://[::1]:8081"),
        ("http://lab:8080", {"dash": ":8081"}, NEAR, "http://lab:8081"),
        ("http://lab:8080", {"dash": ":8081"}, HERE, "http://lab:8080/services/dash"),
        ("https://lab:8443", {"dash": ":8081"}, NEAR, "https://lab:8443/services/dash"),
        ("https://localhost:8443", {"dash": ":8081"}, HERE, "https://localhost:8443/services/dash"),
        ("https://lab:8443", {"dash": "https://dash.example"}, HERE, "https://dash.example"),
        ("https://lab:8443", {"dash": ":8081"}, {}, "http://lab:8081"),
        ("http://localhost:8080", {}, HERE, "http://localhost:8080/services/dash"),
    ],
)
def test_a_page_is_told_a_url_that_it_gets_through_by(
    page: str, services: dict[str, str], upstreams: dict[ServiceName, str], url: str
) -> None:
    assert reachable_services(page, services, upstreams) == {"dash": url}


@pytest.mark.parametrize(
    ("service", "listens"),
    [
        ("render", {"TIGAS_RENDER_HTTP": PAGE, "TIGAS_RENDER_HTTPS": PAGE_HTTPS, "TIGAS_RENDER_QUIC": WEBTRANSPORT}),
        ("dash-packager", {"TIGAS_DASH_HTTP": DASH}),
        ("store", {"TIGAS_STORE_HTTP": STORE}),
        ("shaper", {"TIGAS_SHAPER_HTTP": SHAPER}),
    ],
)
def test_an_image_listens_where_it_is_looked_for(service: str, listens: dict[str, Port]) -> None:
    stages = re.split(r"^FROM ", (ROOT / "Dockerfile").read_text(), flags=re.MULTILINE)
    (image,) = (stage for stage in stages if stage.startswith(f"service AS {COMPOSE[service]['build']['target']}\n"))
    assert dict(re.findall(r"(TIGAS_\w+)=(\S+:\d+)", image)) == {
        name: str(port.all_interfaces) for name, port in listens.items()
    }
    ports = [*listens.values(), WEBRTC] if DASH in listens.values() else listens.values()  # one setting for both
    exposed = re.search(r"^EXPOSE (.*)$", image, re.MULTILINE)
    assert exposed
    assert exposed[1].split() == [f"{port.number}{'/udp' if port.protocol == 'udp' else ''}" for port in ports]
    http = next(iter(listens.values()))
    assert f"HEALTH_URL=http://{http.loopback}/healthz" in image


def test_a_page_learns_of_no_store_where_none_runs() -> None:
    assert "store" in json.loads(services_json(shaped=False))
    assert set(json.loads(services_json(shaped=True, store=False))) == {"dash", "shaper"}
    assert set(json.loads(upstreams_json(shaper_host="10.0.0.1", store=False))) == {"dash", "shaper"}
