"""The locks hold what pyproject.toml asks for, in the versions of constraints.txt, and nothing without a digest."""

from __future__ import annotations

import re
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from locks.update import BUILD, EXTRAS, ROOT, kept, lock, stale

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LINES = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
PINS: dict[str, str] = {canonicalize_name(name): version for name, version in (line.split("==") for line in LINES)}


def asked_for(extra: str) -> list[Requirement]:
    """What an extra of the project needs by itself."""
    found = [*map(Requirement, PROJECT["dependencies"])]
    for requirement in map(Requirement, PROJECT["optional-dependencies"][extra]):
        if requirement.name == "tigas":
            found += [each for name in sorted(requirement.extras) for each in asked_for(name)]
        else:
            found.append(requirement)
    return found


def locked(extra: str) -> dict[str, str]:
    """The versions in a lock."""
    return dict(re.findall(r"^([\w.-]+)==(\S+)", lock(extra).read_text(), flags=re.MULTILINE))


def test_the_locks_are_newer_than_what_they_are_made_from() -> None:
    assert stale() == [], "pyproject.toml or constraints.txt has changed: make lock"


@pytest.mark.parametrize("extra", EXTRAS)
def test_a_lock_has_all_that_is_asked_for_in_the_pinned_version_but_pytorch(extra: str) -> None:
    versions = locked(extra)
    for requirement in asked_for(extra):
        name = canonicalize_name(requirement.name)
        if name == "torch":
            assert name not in versions
        else:
            assert requirement.specifier.contains(versions[name]), name
    assert {name: version for name, version in versions.items() if PINS.get(name, version) != version} == {}


def test_of_the_images_only_those_for_gpus_have_pytorch() -> None:
    with_it = {extra for extra in EXTRAS if "torch" in {requirement.name for requirement in asked_for(extra)}}
    assert with_it == {"dev", "gpu"}
    described = re.search(r"^TORCH_EXTRAS := (.+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert described
    assert {*described[1].split()} == with_it - {"dev"}


@pytest.mark.parametrize("name", [*EXTRAS, BUILD])
def test_every_file_that_is_installed_has_a_digest(name: str) -> None:
    requirements = re.split(r"^(?=[\w-])", lock(name).read_text().partition("\n")[2], flags=re.MULTILINE)
    assert len(requirements) > (20 if name in EXTRAS else 4)
    for requirement in filter(None, requirements):
        assert re.fullmatch(r"\S+==\S+( ; [^\\\n]+)? \\\n(    --hash=sha256:[0-9a-f]{64}( \\)?\n)+", requirement)


@pytest.mark.parametrize("extra", sorted({*EXTRAS} - {"dev"}))
def test_an_image_has_nothing_that_builds_the_wheel(extra: str) -> None:
    assert not {"hatchling", "editables", "trove-classifiers"} & locked(extra).keys()
    assert {"hatchling", "editables"} <= locked(BUILD).keys() & locked("dev").keys()


def test_without_gpu_there_is_no_cuda() -> None:
    requirements = "numpy==2 \\\n    --hash=1\nnvidia-cublas==13 \\\n    --hash=2\ntorch==2 \\\n    --hash=3\n"
    assert list(kept(requirements, "dev")) == ["numpy==2 \\\n    --hash=1\n"]
    assert list(kept(requirements, "gpu")) == ["numpy==2 \\\n    --hash=1\n", "nvidia-cublas==13 \\\n    --hash=2\n"]
