"""deploy/helm: Kubernetes accepts the rendered chart, and its environment variables are settings."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from tigas_render.settings import RenderSettings

CHART = Path(__file__).parents[2] / "deploy/helm"
VALUES: dict[str, Any] = yaml.safe_load((CHART / "values.yaml").read_text())


def value(path: str, values: dict[str, Any]) -> Any:
    if path == ".Release.Name":
        return "walk"
    found: Any = values
    for name in path.removeprefix(".Values.").split("."):
        found = found[name]
    return found


def rendered(name: str, **changes: Any) -> dict[str, Any]:
    """A template with these values: a subset of Helm's language, which is all that the chart uses."""
    values, lines, shown = VALUES | changes, [], True
    for line in (CHART / "templates" / f"{name}.yaml").read_text().splitlines():
        if condition := re.fullmatch(r"\s*\{\{- if (\S+) \}\}", line):
            shown = bool(value(condition[1], values))
        elif re.fullmatch(r"\s*\{\{- end \}\}", line):
            shown = True
        elif shown:
            line = re.sub(
                r"\{\{ (\S+) \| toJson \| quote \}\}", lambda m: json.dumps(json.dumps(value(m[1], values))), line
            )
            lines.append(re.sub(r"\{\{ (\S+) \}\}", lambda m: str(value(m[1], values)), line))
    assert not [line for line in lines if re.search(r"\{\{[ -]", line)], "not rendered"
    made: dict[str, Any] = yaml.safe_load("\n".join(lines))
    return made


@pytest.mark.parametrize("version", ["1.29", "1.37"])
@pytest.mark.parametrize("name", ["deployment", "scenes", "service"])
def test_kubernetes_accepts_it(name: str, version: str) -> None:
    kubernetes_validate.validate(rendered(name), version, strict=True)


def test_a_gpu_is_requested_only_if_values_say_so() -> None:
    def limits(**changes: Any) -> dict[str, Any]:
        (container,) = rendered("deployment", **changes)["spec"]["template"]["spec"]["containers"]
        return dict(container["resources"]["limits"])

    assert limits() == {"memory": "12Gi"}
    assert limits(gpus=2) == {"memory": "12Gi", "nvidia.com/gpu": 2}


def test_the_environment_sets_the_services_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    (container,) = rendered("deployment", allowHosts=["tigas.example.org"])["spec"]["template"]["spec"]["containers"]
    for each in container["env"]:
        monkeypatch.setenv(each["name"], each["value"])
    assert [*RenderSettings().allow_hosts] == ["tigas.example.org"]
