"""Prometheus' configuration and Grafana's dashboard match the services' metrics, and Prometheus accepts both."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml

from tests.compose.test_limits import SERVICES as CONTAINERS
from tests.every_service import SERVICES
from tests.prerequisites import PROMTOOL
from tests.prometheus import Figures, figures
from tigas_common.origins import OriginPolicy
from tigas_common.topology import DASH, PAGE, SHAPER, STORE
from tigas_render.workers import aggregate

ROOT = Path(__file__).parents[2]
PROMETHEUS = ROOT / "deploy/prometheus/prometheus.yml"
GRAFANA = ROOT / "deploy/grafana"
DASHBOARD: dict[str, Any] = json.loads((GRAFANA / "dashboards/tigas.json").read_text(encoding="utf-8"))
PANELS = [panel for panel in DASHBOARD["panels"] if panel["type"] != "row"]
QUERIES = [(panel["title"], target["expr"]) for panel in PANELS for target in panel["targets"]]
OF_PROMETHEUS = {"job", "instance", "le"}
"""Labels that Prometheus adds, or histograms have."""


def documented() -> dict[str, set[str]]:
    """The labels of each metric, as docs/deploy.md has them."""
    rows = (row.split("|") for row in (ROOT / "docs/deploy.md").read_text(encoding="utf-8").splitlines())
    return {
        name: set(re.findall(r"`(\w+)`", row[2]))
        for row in rows
        if len(row) > 3
        for name in re.findall(r"`((?:tigas|process)_\w+)`", row[1])
    }


def names(query: str) -> set[str]:
    """The metrics that a query asks for."""
    without = re.sub(r"\{[^}]*\}|\[[^]]*\]|\b(by|without) *\([^)]*\)", "", query)
    return set(re.findall(r"[a-zA-Z_:][\w:]*(?![\w:]* *\()", without))


def labels(query: str) -> set[str]:
    """The labels that it chooses or groups by."""
    groups = re.findall(r"\b(?:by|without) *\(([^)]*)\)", query)
    chosen = re.findall(r"[{,] *(\w+) *(?:=~|!~|!=|=)", query)
    return {label.strip() for group in groups for label in group.split(",")} | set(chosen)


@pytest.fixture(scope="module")
def anyio_backend() -> str:
    return "asyncio"


@pytest.fixture(scope="module")
async def told(anyio_backend: str, tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """Metrics of all services."""
    found = Figures(aggregate.merge_metrics({}, []).decode()).names | {"up"}  # which Prometheus adds
    for name, service in SERVICES.items():
        async with (
            service(tmp_path_factory.mktemp(name)) as app,
            httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as http,
        ):
            found |= (await figures(http)).names
    return found


@pytest.mark.anyio
@pytest.mark.parametrize(("title", "query"), QUERIES)
async def test_a_panel_asks_for_what_services_tell_by_labels_that_it_has(
    told: set[str], title: str, query: str
) -> None:
    asked = names(query)
    assert asked, "the query names no metric"
    assert asked <= told
    known = documented()
    for name in asked - {"up"}:
        plain = re.sub(r"_(bucket|count|sum)$", "", name)
        assert labels(query) <= known[plain] | OF_PROMETHEUS


@pytest.mark.parametrize("panel", PANELS, ids=lambda panel: panel["title"])
def test_a_legend_shows_labels_that_its_query_keeps(panel: dict[str, Any]) -> None:
    for target in panel["targets"]:
        kept = labels(target["expr"]) | (documented().get(target["expr"], set()))
        assert set(re.findall(r"{{ *(\w+) *}}", target["legendFormat"])) <= kept


def test_names_and_labels_of_a_query_are_found() -> None:
    query = 'histogram_quantile(0.9, sum by (stage, le) (rate(a_bucket{of=~"x|y", edge!="b"}[5m]))) / max(c) + d'
    assert names(query) == {"a_bucket", "c", "d"}
    assert labels(query) == {"stage", "le", "of", "edge"}


def test_panels_lie_beside_each_other_and_have_numbers_of_their_own() -> None:
    numbers = [panel["id"] for panel in DASHBOARD["panels"]]
    assert len(numbers) == len(set(numbers))
    taken: set[tuple[int, int]] = set()
    for panel in DASHBOARD["panels"]:
        place = panel["gridPos"]
        cells = {(place["x"] + x, place["y"] + y) for x in range(place["w"]) for y in range(place["h"])}
        assert place["x"] + place["w"] <= 24
        assert not cells & taken, panel["title"]
        taken |= cells


def test_every_container_with_figures_is_asked_where_it_answers() -> None:
    jobs = yaml.safe_load(PROMETHEUS.read_text())["scrape_configs"]
    targets = {job["job_name"]: job["static_configs"][0]["targets"] for job in jobs}
    assert targets == {
        "render": [f"render:{PAGE.number}"],
        "dash": [f"dash-packager:{DASH.number}"],
        "store": [f"store:{STORE.number}"],
        "shaper": [f"shaper:{SHAPER.number}"],
    }
    policy = OriginPolicy.from_addresses([PAGE.all_interfaces])
    for (target,) in targets.values():
        assert "services" in CONTAINERS[target.partition(":")[0]]["networks"]
        policy.check(target, None, changes=False)
    assert "services" in CONTAINERS["prometheus"]["networks"]


@pytest.mark.parametrize(("name", "port"), [("prometheus", 9090), ("grafana", 3000)])
def test_monitoring_is_asked_for_pinned_and_reached_from_this_machine_alone(name: str, port: int) -> None:
    container = CONTAINERS[name]
    assert container["profiles"] == ["monitoring"]
    assert re.fullmatch(r"[\w/]+:v?\d+\.\d+\.\d+", container["image"])
    assert container["ports"] == [f"127.0.0.1:{port}:{port}"]
    for mount in container["volumes"]:
        source, target, *read_only = mount.split(":")
        if source.startswith("./"):
            assert (ROOT / source).exists()
            assert read_only == ["ro"]
            assert target.startswith("/etc/")


def test_grafana_finds_its_data_and_its_dashboard_and_lets_nobody_change_them() -> None:
    (source,) = yaml.safe_load((GRAFANA / "provisioning/datasources/prometheus.yaml").read_text())["datasources"]
    (variable,) = DASHBOARD["templating"]["list"]
    assert (source["type"], source["uid"]) == (variable["query"], variable["current"]["value"])
    assert source["url"] == "http://prometheus:9090"
    assert all(target["datasource"]["uid"] == "${datasource}" for panel in PANELS for target in panel["targets"])
    (provider,) = yaml.safe_load((GRAFANA / "provisioning/dashboards/tigas.yaml").read_text())["providers"]
    mounts = dict(mount.split(":")[:2] for mount in CONTAINERS["grafana"]["volumes"])
    assert mounts["./deploy/grafana/dashboards"] == provider["options"]["path"]
    told = CONTAINERS["grafana"]["environment"]
    assert told["GF_DASHBOARDS_DEFAULT_HOME_DASHBOARD_PATH"] == f"{provider['options']['path']}/tigas.json"
    assert (told["GF_AUTH_ANONYMOUS_ORG_ROLE"], provider["allowUiUpdates"]) == ("Viewer", False)


def promtool(*arguments: str) -> str:
    """Its output, after success."""
    done = subprocess.run(("promtool", *arguments), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@PROMTOOL.mark
def test_prometheus_takes_the_configuration() -> None:
    assert "is valid prometheus config file syntax" in promtool("check", "config", str(PROMETHEUS))


@PROMTOOL.mark
def test_prometheus_takes_every_query(tmp_path: Path) -> None:
    def rules() -> Iterator[dict[str, str]]:
        for number, (_, query) in enumerate(QUERIES):
            yield {"record": f"panel_{number}", "expr": query.replace("$__rate_interval", "1m")}

    file = tmp_path / "rules.yml"
    file.write_text(yaml.safe_dump({"groups": [{"name": "panels", "rules": list(rules())}]}))
    assert f"{len(QUERIES)} rules found" in promtool("check", "rules", str(file))
