"""Imports run one way, no service imports another, and docs/architecture.md draws them. Imports for types count.

Tests and benchmarks may import every service and `reference`, but not one another.
"""

from __future__ import annotations

import re
from pathlib import Path

import networkx
import pytest
from grimp import build_graph

COMMON = "tigas_common"
ROOT = Path(__file__).parents[1]
SERVICES = sorted(path.name for path in ROOT.glob("services/*/tigas*"))
ARCHITECTURE = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")

graph = build_graph(*SERVICES, "benchmarks", "reference", "tests", cache_dir=None)


def test_every_service_is_looked_at() -> None:
    assert {COMMON, "tigas_dash", "tigas_experiments", "tigas_render", "tigas_shaper", "tigas_testbed"} <= set(SERVICES)


@pytest.mark.parametrize("service", SERVICES)
def test_a_service_imports_only_itself_and_what_is_common(service: str) -> None:
    foreign = {
        f"{module} imports {imported}"
        for module in graph.find_descendants(service) | {service}
        for imported in graph.find_modules_directly_imported_by(module)
        if imported.partition(".")[0] not in (service, COMMON)
    }
    assert foreign == set()


def test_benchmarks_import_no_tests_and_only_their_own_tests_import_them() -> None:
    across = {
        f"{module} imports {imported}"
        for module in graph.modules
        for imported in graph.find_modules_directly_imported_by(module)
        if (module.split(".")[0], imported.split(".")[0]) in (("benchmarks", "tests"), ("tests", "benchmarks"))
        and not module.startswith("tests.benchmarks.")
    }
    assert across == set()


def test_the_reference_imports_services_alone() -> None:
    imported = {
        name.partition(".")[0]
        for module in graph.find_descendants("reference")
        for name in graph.find_modules_directly_imported_by(module)
    }
    assert imported <= {"reference", *SERVICES}


def test_modules_form_no_circle() -> None:
    imports = networkx.DiGraph(
        (module, imported) for module in graph.modules for imported in graph.find_modules_directly_imported_by(module)
    )
    assert [sorted(circle) for circle in networkx.strongly_connected_components(imports) if len(circle) > 1] == []


@pytest.mark.parametrize(
    "package",
    # the folders in tests use one another's stand-ins
    sorted(name for name in graph.modules if graph.find_children(name) and name != "tests"),
)
def test_a_packages_modules_and_folders_form_no_circle(package: str) -> None:
    importers_of_init = graph.find_modules_that_directly_import(package) & graph.find_descendants(package)
    closing = {(module, package) for module in importers_of_init} | graph.nominate_cycle_breakers(package)
    assert {f"{importer} imports {imported}" for importer, imported in closing} == set()


@pytest.mark.parametrize("service", [service for service in SERVICES if f"%% {service}\n" in ARCHITECTURE])
def test_the_drawn_arrows_are_the_imports(service: str) -> None:
    drawn = networkx.DiGraph(
        re.findall(r"(\w+) --> (\w+)", ARCHITECTURE.partition(f"%% {service}\n")[2].split("```")[0])
    )
    imports = networkx.DiGraph()
    for module in graph.find_descendants(service):
        for imported in graph.find_modules_directly_imported_by(module):
            ends = [name.split(".")[1] for name in (module, imported) if name.startswith(f"{service}.")]
            if len(set(ends)) == 2:
                imports.add_edge(*ends)
    reached = networkx.transitive_closure(imports).subgraph(drawn.nodes)
    assert set(drawn.edges) == set(networkx.transitive_reduction(reached).edges)
