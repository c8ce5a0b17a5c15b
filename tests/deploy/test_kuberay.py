"""deploy/kuberay.yaml: Kubernetes takes it, KubeRay knows its fields, and nothing has more rights than it needs."""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from tigas_cluster.settings import ClusterSettings

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "deploy/kuberay.yaml").read_text()
OBJECTS: dict[str, Any] = {each["kind"]: each for each in yaml.safe_load_all(TEXT)}
CLUSTER = OBJECTS["RayCluster"]["spec"]
GROUPS = {"head": CLUSTER["headGroupSpec"], "gpu": CLUSTER["workerGroupSpecs"][0]}
VERSIONS = ["1.29", "1.37"]

# ray-operator/apis/ray/v1/raycluster_types.go of KubeRay
CLUSTER_FIELDS = {"autoscalerOptions", "enableInTreeAutoscaling", "headGroupSpec", "rayVersion", "workerGroupSpecs"}
AUTOSCALER_FIELDS = {"idleTimeoutSeconds", "resources", "securityContext", "upscalingMode", "version"}
HEAD_FIELDS = {"rayStartParams", "serviceType", "template"}
WORKER_FIELDS = {"groupName", "maxReplicas", "minReplicas", "rayStartParams", "replicas", "template"}


def template(group: str) -> dict[str, Any]:
    """A group's pods, as an object of Kubernetes' own."""
    made = copy.deepcopy(GROUPS[group]["template"])
    return {"apiVersion": "v1", "kind": "PodTemplate", "metadata": {"name": group}, "template": made}


def container(group: str) -> dict[str, Any]:
    """Of a group's pods."""
    (found,) = GROUPS[group]["template"]["spec"]["containers"]
    return dict(found)


def environment(group: str) -> dict[str, str]:
    """Variables with a value."""
    return {each["name"]: each["value"] for each in container(group)["env"] if "value" in each}


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("group", GROUPS)
def test_kubernetes_takes_the_pods(group: str, version: str) -> None:
    kubernetes_validate.validate(template(group), version, strict=True)
    broken = template(group)
    broken["template"]["spec"]["containers"][0]["port"] = []
    with pytest.raises(kubernetes_validate.ValidationError, match="port"):
        kubernetes_validate.validate(broken, version, strict=True)


@pytest.mark.parametrize("version", VERSIONS)
def test_kubernetes_takes_the_other_objects_and_the_autoscaler(version: str) -> None:
    for kind, found in OBJECTS.items():
        if kind != "RayCluster":
            kubernetes_validate.validate(found, version, strict=True)
    options = CLUSTER["autoscalerOptions"]
    pod = template("head")
    pod["template"]["spec"]["containers"].append(
        {"name": "autoscaler", "resources": options["resources"], "securityContext": options["securityContext"]}
    )
    kubernetes_validate.validate(pod, version, strict=True)


def test_kuberay_knows_the_other_fields() -> None:
    assert OBJECTS["RayCluster"]["apiVersion"] == "ray.io/v1"
    assert set(OBJECTS["RayCluster"]) == {"apiVersion", "kind", "metadata", "spec"}
    assert set(CLUSTER) <= CLUSTER_FIELDS
    assert set(CLUSTER["autoscalerOptions"]) <= AUTOSCALER_FIELDS
    assert set(GROUPS["head"]) <= HEAD_FIELDS
    assert set(GROUPS["gpu"]) <= WORKER_FIELDS
    for group in GROUPS.values():
        assert all(type(value) is str for value in group["rayStartParams"].values())


def test_ray_has_the_version_that_is_installed() -> None:
    pinned = re.search(r'^name = "ray"\nversion = "(.+)"$', (ROOT / "uv.lock").read_text(), flags=re.MULTILINE)
    assert pinned is not None
    assert CLUSTER["rayVersion"] == pinned[1]


@pytest.mark.parametrize("group", GROUPS)
def test_a_pod_has_no_rights_to_spare(group: str) -> None:
    pod, only = GROUPS[group]["template"]["spec"], container(group)
    assert pod["securityContext"]["runAsNonRoot"] is True
    assert f"--uid {pod['securityContext']['runAsUser']} " in (ROOT / "Dockerfile").read_text()
    assert only["securityContext"] == {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }
    assert not {"hostNetwork", "hostPID", "hostIPC"} & set(pod)
    mounted = {each["name"] for each in only["volumeMounts"]}
    assert mounted == {each["name"] for each in pod["volumes"]}
    assert not any("hostPath" in each for each in pod["volumes"])
    assert "memory" in only["resources"]["limits"]


def test_only_what_viewers_need_is_open_to_them() -> None:
    ours = {"podSelector": {"matchLabels": {"ray.io/cluster": OBJECTS["RayCluster"]["metadata"]["name"]}}}
    policy = OBJECTS["NetworkPolicy"]["spec"]
    inside, outside = policy["ingress"]
    assert policy["podSelector"] == ours["podSelector"]
    assert inside == {"from": [ours]}
    on_nodes = {
        (each.get("protocol", "TCP"), each["containerPort"]) for each in container("gpu")["ports"] if "hostPort" in each
    }
    (page,) = [each["containerPort"] for each in container("head")["ports"] if each["name"] == "page"]
    assert {(each["protocol"], each["port"]) for each in outside["ports"]} == on_nodes | {("TCP", page)}


def test_what_names_a_port_means_one_that_is_there() -> None:
    for group in GROUPS:
        only = container(group)
        names = {each["name"] for each in only["ports"]}
        for probe in ("readinessProbe", "livenessProbe"):
            (port,) = [check["port"] for check in only[probe].values() if isinstance(check, dict)]
            assert port in names
    assert GROUPS["gpu"]["rayStartParams"]["node-manager-port"] == "6380"
    (served,) = OBJECTS["Service"]["spec"]["ports"]
    assert served["targetPort"] in {each["name"] for each in container("head")["ports"]}
    assert all(each["hostPort"] == each["containerPort"] for each in container("gpu")["ports"] if "hostPort" in each)


def test_the_page_s_name_is_the_same_everywhere() -> None:
    (rule,), (tls,) = OBJECTS["Ingress"]["spec"]["rules"], OBJECTS["Ingress"]["spec"]["tls"]
    assert tls["hosts"] == [rule["host"]]
    assert environment("head")["TIGAS_CLUSTER_ALLOW_HOSTS"] == f'["{rule["host"]}"]'
    assert rule["http"]["paths"][0]["backend"]["service"]["name"] == OBJECTS["Service"]["metadata"]["name"]


def test_hosts_grow_as_far_as_nodes_do() -> None:
    lowest, highest = environment("head")["TIGAS_CLUSTER_HOSTS"].split("..")
    assert [int(lowest), int(highest)] == [GROUPS["gpu"]["minReplicas"], GROUPS["gpu"]["maxReplicas"]]


def test_hosts_listen_where_nodes_are_open() -> None:
    ports = {each["name"]: each["hostPort"] for each in container("gpu")["ports"] if "hostPort" in each}
    told = environment("head")
    assert told["TIGAS_CLUSTER_HOST_HTTP_PORT"] == str(ports["http"])
    assert told["TIGAS_CLUSTER_HOST_QUIC_PORT"] == str(ports["quic"])
    assert told["TIGAS_CLUSTER_SCENES"] in {each["mountPath"] for each in container("gpu")["volumeMounts"]}


def test_what_is_set_is_a_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in environment("head").items():
        monkeypatch.setenv(name, value)
    settings = ClusterSettings()
    assert str(settings.http) == "0.0.0.0:8080"
    names = {f"TIGAS_CLUSTER_{name.upper()}" for name in ClusterSettings.model_fields}
    assert {name for name in environment("head") if name.startswith("TIGAS_")} <= names
