"""Allowed hosts and pages, and the headers of every answer."""

from __future__ import annotations

from collections.abc import Mapping

import httpx
import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from tigas_common.address import Address
from tigas_common.errors import TigasError
from tigas_common.origins import ForeignHost, ForeignOrigin, OriginCheck, OriginPolicy
from tigas_common.web import EXCEPTION_HANDLERS

pytestmark = pytest.mark.anyio

EMBEDDER = "https://page.example"
LOCAL = OriginPolicy.from_addresses(
    [Address("127.0.0.1", 8080), Address("localhost", 4433)], ["tigas.example"], [EMBEDDER]
)
OPEN = OriginPolicy.from_addresses([Address("0.0.0.0", 8080)], ["tigas.example"], [EMBEDDER])
STRICT = OriginPolicy.from_addresses([Address("127.0.0.1", 8090)], programs=False)


def refusal(policy: OriginPolicy, host: str, origin: str | None = None, *, changes: bool = True) -> type | None:
    try:
        policy.check(host, origin, changes=changes)
    except TigasError as error:
        return type(error)
    return None


@pytest.mark.parametrize(
    ("host", "local", "on_network"),
    [
        ("localhost:8080", True, True),
        ("127.0.0.1:8080", True, True),
        ("[::1]:8080", True, True),
        ("10.1.2.3", True, True),
        ("[2001:db8::1]", True, True),
        ("tigas.example:8080", True, True),
        ("TIGAS.example", True, True),
        ("render:8080", False, True),
        ("lab.local", False, True),
        ("lab.internal", False, True),
        ("evil.example", False, False),
        ("tigas.example.evil.example", False, False),
        ("localhost.evil.example", False, False),
        ("127.0.0.1.nip.io", False, False),
        ("evil.example@localhost", False, False),
        ("x" * 10_000 + ".example", False, False),
        ("", False, False),
    ],
)
def test_a_name_that_anybody_can_make_lead_here_is_refused(host: str, local: bool, on_network: bool) -> None:
    for policy, own in ((LOCAL, local), (OPEN, on_network)):
        assert refusal(policy, host) == (None if own else ForeignHost)
        page = f"http://{host}"  # the own host, from its browser's point of view
        assert refusal(policy, host, page) == (None if own else ForeignHost)


@pytest.mark.parametrize(
    ("origin", "allowed"),
    [
        ("http://localhost:8080", True),
        ("http://127.0.0.1:5173", True),
        ("https://[::1]:8443", True),
        (EMBEDDER, True),
        (f"{EMBEDDER}:444", False),
        (f"{EMBEDDER}.evil.example", False),
        ("https://evil.example", False),
        ("http://127.0.0.1.evil.example", False),
        ("http://10.1.2.3:8080", False),
        ("http://labhost:8080", False),
        ("chrome-extension://abcdef", False),
        ("null", False),
        ("http://[", False),
        ("x" * 10_000, False),
        ("", False),
    ],
)
def test_pages_of_its_own_host_and_those_that_are_named_may_use_it(origin: str, allowed: bool) -> None:
    for policy in (LOCAL, OPEN):
        for changes in (True, False):
            assert refusal(policy, "localhost:8081", origin, changes=changes) == (None if allowed else ForeignOrigin)


def test_a_refusal_names_what_was_refused_but_not_all_of_it() -> None:
    with pytest.raises(ForeignOrigin, match=r"https://evil\.example.*allow_origins.*\.$"):
        LOCAL.check("localhost", "https://evil.example")
    for host, origin in (("x" * 10_000, None), ("localhost", "x" * 10_000)):
        with pytest.raises(TigasError) as refused:
            LOCAL.check(host, origin)
        assert len(refused.value.detail) < 200


def test_its_own_host_is_the_one_that_it_was_asked_under() -> None:
    assert refusal(OPEN, "labhost:8081", "http://labhost:8080") is None
    assert refusal(OPEN, "10.1.2.3:8081", "http://10.1.2.3:8080") is None
    assert refusal(OPEN, "10.1.2.3:8081", "http://10.1.2.4:8080") == ForeignOrigin
    assert refusal(OPEN, "10.1.2.3:8081", "http://localhost:8080") == ForeignOrigin


def test_programs_say_no_origin_which_a_strict_service_wants_for_a_change() -> None:
    assert refusal(LOCAL, "localhost") is None
    assert refusal(STRICT, "localhost") == ForeignOrigin
    assert refusal(STRICT, "localhost", changes=False) is None
    assert refusal(STRICT, "localhost", "http://localhost:8080") is None


# -- over HTTP ---------------------------------------------------------------------------------------------------------


def client(policy: OriginPolicy) -> httpx.AsyncClient:
    async def hello(request: Request) -> Response:
        return PlainTextResponse("hello")

    async def page(request: Request) -> Response:
        return PlainTextResponse("page", headers={"Content-Security-Policy": "default-src 'self'"})

    async def fails(request: Request) -> Response:
        raise RuntimeError("it failed")

    routes = [Route("/", hello, methods=["GET", "POST"]), Route("/page", page), Route("/fails", fails)]
    app = OriginCheck(Starlette(routes=routes, exception_handlers=EXCEPTION_HANDLERS), policy)
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    return httpx.AsyncClient(transport=transport, base_url="http://localhost:8080")


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}, 403),
        ({"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "iframe"}, 403),
        ({"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}, 200),
        ({"Sec-Fetch-Site": "same-site", "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}, 200),
        ({"Sec-Fetch-Site": "none", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}, 200),
        ({}, 200),
    ],
)
async def test_another_site_may_link_here_and_no_more(headers: Mapping[str, str], status: int) -> None:
    async with client(OriginPolicy()) as http:
        assert (await http.get("/", headers=headers)).status_code == status
    async with client(LOCAL) as http:  # one may embed it
        framed = status == 200 or headers["Sec-Fetch-Dest"] == "iframe"
        assert (await http.get("/", headers=headers)).status_code == (200 if framed else 403)


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/", {}, 200),
        ("/nowhere", {}, 404),
        ("/fails", {}, 500),
        ("/", {"Origin": "https://evil.example"}, 403),
        ("/", {"Host": "evil.example"}, 421),
    ],
)
async def test_no_answer_can_be_framed_sniffed_or_embedded(path: str, headers: Mapping[str, str], status: int) -> None:
    async with client(OriginPolicy()) as http:
        answer = await http.get(path, headers=headers)
    assert answer.status_code == status
    assert answer.headers["content-security-policy"] == "default-src 'none'; frame-ancestors 'none'"
    assert answer.headers["cross-origin-resource-policy"] == "same-origin"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "strict-origin"


async def test_a_page_keeps_its_own_policy_and_is_framed_by_allowed_pages_alone() -> None:
    async with client(LOCAL) as http:
        policy = (await http.get("/page")).headers["content-security-policy"]
    assert policy == f"default-src 'self'; frame-ancestors {EMBEDDER}"


async def test_allowed_pages_of_other_origins_may_read_and_be_asked_for_first() -> None:
    async with client(LOCAL) as http:
        for page in ("http://localhost:5173", EMBEDDER):
            answer = await http.post("/", headers={"Origin": page})
            assert (answer.status_code, answer.headers["access-control-allow-origin"]) == (200, page)
            assert answer.headers["vary"] == "Origin"
            for method in ("DELETE", "HEAD"):  # HEAD of an upload that goes on
                asked = {"Origin": page, "Access-Control-Request-Method": method}
                answer = await http.options("/", headers=asked)
                assert (answer.status_code, answer.headers["access-control-allow-origin"]) == (200, page)
        assert "access-control-allow-origin" not in (await http.get("/")).headers
