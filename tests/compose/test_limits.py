"""Resources and permissions of containers in compose.yaml and compose.cluster.yaml. Needs no containers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from tigas_experiments.store.limited import check_limit
from tigas_render.settings import RenderSettings

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "compose.yaml").read_text()
DOCS = (ROOT / "docs/deploy.md").read_text()
DEFAULT = re.compile(r"\$\{(\w+):-([^}]*)\}")


def services(text: str) -> dict[str, Any]:
    """With the defaults of all variables."""
    found: dict[str, Any] = yaml.safe_load(DEFAULT.sub(r"\2", text))["services"]
    return found


SERVICES = services(TEXT)
CLUSTER_TEXT = (ROOT / "compose.cluster.yaml").read_text()
MACHINES = services(CLUSTER_TEXT)


def gigabytes(service: str) -> float:
    """A container's memory, in 10⁹ bytes: Docker's g is a binary one."""
    number, _unit = re.fullmatch(r"(\d+)(g)", (SERVICES | MACHINES)[service]["mem_limit"]).groups()  # type: ignore[union-attr]
    return int(number) * 2**30 / 1e9


@pytest.mark.parametrize("name", [*SERVICES, *MACHINES])
def test_every_container_is_limited_and_has_no_rights_to_spare(name: str) -> None:
    container = (SERVICES | MACHINES)[name]
    assert 1 <= gigabytes(name) <= 16
    assert 128 <= container["pids_limit"] <= 4096
    assert container["read_only"] is True
    assert container["cap_drop"] == ["ALL"]
    assert container.get("cap_add", []) == (["NET_ADMIN"] if name == "shaper" else [])
    assert "no-new-privileges:true" in container["security_opt"]
    assert "privileged" not in container
    if name in MACHINES:
        assert all(re.match(r"127\.0\.0\.\d+:(8080:8080|4433:4433/udp)$", port) for port in container["ports"])
    else:
        assert 0 <= container["cpus"] <= 1, "a machine with one processor refuses to start what is promised two"
        assert container["cpu_shares"] <= SERVICES["shaper"]["cpu_shares"]


def test_ray_s_network_has_no_way_out() -> None:
    networks = yaml.safe_load(CLUSTER_TEXT)["networks"]
    assert networks["cluster"]["internal"] is True
    for told in MACHINES.values():
        address = told["networks"]["cluster"]["ipv4_address"]
        assert address in f"{told['command']} {told['environment']}", "Ray listens on another network"


def test_a_container_has_room_for_what_its_service_may_take() -> None:
    scenes = float(SERVICES["render"]["environment"]["TIGAS_RENDER_MEMORY_GB"])
    assert scenes == RenderSettings.model_fields["memory_gb"].default
    assert scenes + 2 < gigabytes("render")
    longest = 224_000_000  # a page's run of two hours
    assert 13 * longest / 1e9 + 1 < gigabytes("store")
    assert check_limit(longest).memory / 1e9 + 1 < gigabytes("store")


def test_every_setting_of_a_limit_is_documented_with_its_default() -> None:
    both = set(DEFAULT.findall(TEXT + CLUSTER_TEXT))
    found = [pair for pair in both if pair[0].endswith(("_MEMORY", "_CPUS", "_PIDS", "_MEMORY_GB"))]
    assert len(found) == 16
    rows = [line for line in DOCS.splitlines() if line.startswith("|")]
    for name, default in found:
        assert any(name in row and default in row.replace(" GiB", "g") for row in rows), name
