"""Which pages may change something, and how requests are refused."""

from __future__ import annotations

import pytest

from tests.experiments.store.conftest import Running, plan, slug, upload

pytestmark = pytest.mark.anyio


async def test_what_is_not_there_is_told_as_everywhere(store: Running) -> None:
    for method, path, status in (("GET", "/none", 404), ("PUT", "/experiments", 405), ("GET", "/experiments/x/y", 404)):
        answer = await store.http.request(method, path)
        assert (answer.status_code, answer.headers["content-type"]) == (status, "application/problem+json")


async def test_a_plan_has_a_limit(store: Running) -> None:
    answer = await store.http.post("/experiments", json={"file": "x" * 16_000_000})
    assert (answer.status_code, answer.json()["type"]) == (413, "tigas:body-too-large")
    assert store.kept() == []


PAGES = {
    None: True,
    "http://127.0.0.1:8080": True,
    "http://localhost:8080": True,
    "https://page.example": True,
    "https://evil.example": False,
    "http://127.0.0.1.evil.example": False,
    "null": False,
    "http://[": False,
}


async def test_only_the_labs_page_may_change_experiments(store: Running) -> None:
    for origin, allowed in PAGES.items():
        headers = {} if origin is None else {"origin": origin}
        experiment = await store.create()
        made = await store.http.post("/experiments", json=plan(), headers=headers)
        added = await store.http.put(f"/experiments/{experiment}/runs/{slug()}", json=upload(), headers=headers)
        removed = await store.http.delete(f"/experiments/{experiment}", headers=headers)
        statuses = [made.status_code, added.status_code, removed.status_code]
        assert statuses == ([201, 200, 204] if allowed else [403] * 3), origin
        assert (store.results / experiment).is_dir() == (not allowed)
        assert allowed or removed.json()["type"] == "tigas:foreign-origin"


@pytest.mark.parametrize(
    ("host", "status"), [("evil.example", 421), ("labhost", 201), ("lab.local", 201), ("10.1.2.3", 201)]
)
async def test_a_name_that_is_made_to_lead_here_is_foreign(store: Running, host: str, status: int) -> None:
    headers = {"host": f"{host}:8091", "origin": f"http://{host}:8080"}
    made = await store.http.post("/experiments", json=plan(), headers=headers)
    assert made.status_code == status


async def test_the_page_may_ask_across_origins(store: Running) -> None:
    page = "http://localhost:8080"
    asked = {"origin": page, "access-control-request-headers": "content-type"}
    for method in ("POST", "PUT", "DELETE"):
        answer = await store.http.options("/experiments/x", headers=asked | {"access-control-request-method": method})
        assert (answer.status_code, answer.headers["access-control-allow-origin"]) == (200, page)
    assert (await store.http.get("/healthz", headers={"origin": page})).headers["access-control-allow-origin"] == page
    refused = await store.http.get("/experiments/x", headers={"origin": page})
    assert refused.headers["access-control-allow-origin"] == page, "the page cannot read why"
