"""Imports run one way: no service imports another, and nothing is imported in a circle. Imports for types count."""

from __future__ import annotations

from pathlib import Path

import pytest
from grimp import build_graph

COMMON = "tigas_common"
SERVICES = sorted(path.name for path in Path(__file__).parents[1].glob("services/*/tigas_*"))

graph = build_graph(*SERVICES, cache_dir=None)


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


@pytest.mark.parametrize("package", sorted(name for name in graph.modules if graph.find_children(name)))
def test_a_packages_modules_and_folders_form_no_circle(package: str) -> None:
    importers_of_init = graph.find_modules_that_directly_import(package) & graph.find_descendants(package)
    closing = {(module, package) for module in importers_of_init} | graph.nominate_cycle_breakers(package)
    assert {f"{importer} imports {imported}" for importer, imported in closing} == set()
