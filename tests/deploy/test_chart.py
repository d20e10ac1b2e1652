"""The Helm chart: its objects are valid, run without privileges, and have settings that the programs accept."""

import json
import tomllib
from pathlib import Path

import kubernetes_validate
import pytest
import yaml

from charts import (
    CHART,
    SETS,
    Document,
    container,
    helm,
    labels,
    named,
    pod,
    refused,
    rendered,
    secrets,
    selects,
    variables,
    workloads,
)
from linked_fleet_agent.settings import read_settings
from linked_fleet_agent.wire.trust import Credentials
from linked_fleet_gateway.app.settings import GatewaySettings
from running import ROOT

pytestmark = pytest.mark.test_all  # needs Go, which builds Helm
_OLDEST, _NEWEST = "1.30", "1.37"
SMALL, PRODUCTION, EXTERNAL = (
    CHART / "ci" / f"{name}-values.yaml" for name in ("small", "production", "external-redis")
)
each_set = pytest.mark.parametrize("values", SETS, ids=lambda path: path.name.removesuffix("-values.yaml"))


def test_there_are_three_sets_of_values() -> None:
    assert {SMALL, PRODUCTION, EXTERNAL} == set(SETS)


@each_set
def test_helm_finds_nothing_wrong(values: Path) -> None:
    done = helm("lint", "--strict", CHART, "--values", values)
    assert done.returncode == 0, done.stdout
    assert "0 chart(s) failed" in done.stdout


@each_set
@pytest.mark.parametrize("version", [_OLDEST, _NEWEST])
def test_each_object_is_as_kubernetes_has_it(values: Path, version: str) -> None:
    """Unknown fields are errors, too. The schemas are in the package; nothing is downloaded."""
    documents = rendered(values, version=f"{version}.0")
    assert len(documents) > 10
    for document in documents:
        kubernetes_validate.validate(document, version, strict=True)


def test_the_validator_finds_what_is_wrong() -> None:
    wrong = json.loads(json.dumps(named(rendered(SMALL), "Deployment", "lf-linked-fleet-gateway")))
    wrong["spec"]["template"]["spec"]["containers"][0]["readinessProbes"] = {}
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(wrong, _NEWEST, strict=True)


def test_the_chart_has_the_version_of_the_package() -> None:
    ours = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    chart = yaml.safe_load((CHART / "Chart.yaml").read_text())
    assert (chart["version"], chart["appVersion"]) == (ours, ours)
    assert container(_gateway(SMALL))["image"] == f"linked-fleet/gateway:{ours}"


def test_images_of_others_are_those_of_compose() -> None:
    compose = (ROOT / "docker-compose.yml").read_text()
    images = yaml.safe_load((CHART / "values.yaml").read_text())["images"]
    for part, variable in (("router", "ZENOH_TAG"), ("redis", "REDIS_TAG")):
        assert f"{images[part]['repository']}:${{{variable}:-{images[part]['tag']}}}" in compose


@each_set
def test_pods_run_as_nobody_with_file_systems_that_are_read_only(values: Path) -> None:
    for workload in workloads(rendered(values)):
        spec, one = pod(workload), container(workload)
        assert spec["securityContext"]["runAsNonRoot"] and spec["securityContext"]["runAsUser"] > 0
        assert spec["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
        assert spec["automountServiceAccountToken"] is False
        own = one["securityContext"]
        assert own["readOnlyRootFilesystem"] and not own["allowPrivilegeEscalation"]
        assert own["capabilities"] == {"drop": ["ALL"]}
        assert "/tmp" in {mount["mountPath"] for mount in one["volumeMounts"]}
        assert one["resources"]["limits"]["memory"] and one["resources"]["requests"]["cpu"]


@each_set
def test_each_service_and_budget_finds_pods_and_their_ports(values: Path) -> None:
    documents = rendered(values)
    for each in documents:
        if each["kind"] == "Service":
            (served,) = (w for w in workloads(documents) if each["spec"]["selector"].items() <= labels(w).items())
            ports = {port["name"] for port in container(served)["ports"]}
            assert {port["targetPort"] for port in each["spec"]["ports"]} <= ports
        if each["kind"] == "PodDisruptionBudget":
            assert sum(selects(each["spec"]["selector"], workload) for workload in workloads(documents)) == 1


@each_set
def test_each_pod_is_behind_a_policy_and_redis_hears_gateways_alone(values: Path) -> None:
    documents = rendered(values)
    policies = [each["spec"] for each in documents if each["kind"] == "NetworkPolicy"]
    for workload in workloads(documents):
        (own,) = (each for each in policies if selects(each["podSelector"], workload))
        assert own["policyTypes"] == ["Ingress", "Egress"]
        if workload["metadata"]["name"].endswith("-redis"):
            (rule,) = own["ingress"]
            (peer,) = rule["from"]
            assert [w["metadata"]["name"] for w in workloads(documents) if selects(peer["podSelector"], w)] == [
                "lf-linked-fleet-gateway"
            ]
            assert "egress" not in own


def _gateway(values: Path) -> Document:
    return named(rendered(values), "Deployment", "lf-linked-fleet-gateway")


@each_set
def test_gateways_take_their_settings(values: Path) -> None:
    """A variable that the program does not read would be a setting without effect."""
    found = variables(_gateway(values))
    settings = GatewaySettings.read(found, [])
    chosen = yaml.safe_load(values.read_text())
    assert settings.public_urls == (chosen["publicUrl"],)
    assert settings.log_format == "json"
    assert ("anonymous" in settings.allow) is chosen.get("allowAnonymous", False)
    assert ("plain-http" in settings.allow) is (settings.tls_cert is None)
    assert len(settings.zenoh_connect) == chosen["zenoh"].get("replicas", 3)
    documented = (ROOT / "docs" / "SETTINGS.md").read_text()
    assert {name for name in found if f"`{name}`" not in documented} <= {"REDIS_PASSWORD"}


@each_set
def test_agents_take_their_settings(values: Path) -> None:
    documents = rendered(values)
    for workload in workloads(documents):
        if "linked-fleet/agent" not in labels(workload):
            continue
        found = variables(workload)
        plain = {name: value for name, value in found.items() if not name.endswith(("_CA", "_CERT", "_KEY"))}
        settings = read_settings([], plain, "host")
        (endpoint,) = settings.zenoh_connect
        service = named(documents, "Service", "lf-linked-fleet-routers")
        assert endpoint.partition("/")[2] == f"{service['metadata']['name']}.robots.svc:7447"
        assert workload["spec"]["replicas"] == 1 and workload["spec"]["strategy"] == {"type": "Recreate"}


@each_set
def test_files_that_settings_name_are_mounted(values: Path) -> None:
    for workload in workloads(rendered(values)):
        mounts = [mount["mountPath"] for mount in container(workload)["volumeMounts"]]
        volumes = {each["name"] for each in pod(workload)["volumes"]} | {"data"}
        assert {mount["name"] for mount in container(workload)["volumeMounts"]} <= volumes
        for value in variables(workload).values():
            if value.startswith("/etc/linked-fleet/"):
                assert any(value.startswith(f"{mount}/") for mount in mounts), value


def test_secrets_are_used_and_never_made() -> None:
    assert secrets(rendered(PRODUCTION)) == {
        "fleet-tls", "fleet-identities", "fleet-session", "fleet-redis", "wire-router", "wire-gateway", "wire-door",
    }  # fmt: skip
    assert secrets(rendered(EXTERNAL)) == {
        "fleet-identities", "hall-1-redis", "hall-1-redis-ca", "wire-router", "wire-gateway",
    }  # fmt: skip
    assert not [each for values in SETS for each in rendered(values) if each["kind"] == "Secret"]


def test_gateways_are_scaled_by_numbers_that_they_have() -> None:
    scaler = named(rendered(PRODUCTION), "HorizontalPodAutoscaler", "lf-linked-fleet-gateway")["spec"]
    wanted = {each["pods"]["metric"]["name"] for each in scaler["metrics"]}
    rules = yaml.safe_load((ROOT / "deploy/helm/prometheus-adapter.yaml").read_text())["rules"]["custom"]
    series = {rule["seriesQuery"].partition("{")[0] for rule in rules}
    assert wanted == {name.replace("http_requests_total", "http_requests_per_second") for name in series}
    operating = (ROOT / "docs" / "OPERATING.md").read_text()
    assert all(f"| `{name.removeprefix('linked_fleet_')}` |" in operating for name in series)
    assert "replicas" not in _gateway(PRODUCTION)["spec"], "the autoscaler has the say"
    assert scaler["minReplicas"] == 3


def test_updates_never_leave_fewer_gateways() -> None:
    spec = _gateway(PRODUCTION)["spec"]
    assert spec["strategy"]["rollingUpdate"] == {"maxSurge": 1, "maxUnavailable": 0}
    probes = {name: container(_gateway(PRODUCTION))[f"{name}Probe"]["httpGet"] for name in ("startup", "readiness")}
    assert {name: probe["path"] for name, probe in probes.items()} == {
        "startup": "/health/ready", "readiness": "/health/live",
    }  # fmt: skip
    assert {probe["scheme"] for probe in probes.values()} == {"HTTPS"}


def test_an_external_redis_takes_the_place_of_ours() -> None:
    documents = rendered(EXTERNAL)
    assert not [each for each in documents if each["metadata"]["name"].endswith("-redis")]
    (url,) = (each for each in container(_gateway(EXTERNAL))["env"] if each["name"] == "REDIS_URL")
    assert url["valueFrom"] == {"secretKeyRef": {"name": "hall-1-redis", "key": "url"}}
    policy = named(documents, "NetworkPolicy", "lf-linked-fleet-gateway")["spec"]["egress"]
    assert {"ports": [{"port": 6380}], "to": [{"ipBlock": {"cidr": "203.0.113.0/24"}}]} in policy


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        (("allowAnonymous=true",), "publicUrl is missing"),
        (("publicUrl=https://a.example",), "anybody moves the robots"),
        (("publicUrl=https://a.example/fleet", "allowAnonymous=true"), "publicUrl"),
        (("publicUrl=https://a.example", "allowAnonymous=true", "zenoh.service.type=NodePort"), "enable zenoh.tls"),
        (("publicUrl=https://a.example", "allowAnonymous=true", "zenoh.tls.enabled=true"), "routerSecret"),
        (("publicUrl=https://a.example", "allowAnonymous=true", "redis.external.enabled=true"), "urlSecret"),
        (("publicUrl=https://a.example", "allowAnonymous=true", "gateways.replica=3"), "replica"),
    ],
)
def test_impossible_values_are_refused_with_a_sentence(settings: tuple[str, ...], reason: str) -> None:
    assert reason in refused(*settings)


def test_the_mounted_certificates_are_credentials_of_gateways(tmp_path: Path) -> None:
    """Variables and keys of secrets are the three of ``Credentials``."""
    found = variables(_gateway(PRODUCTION))
    names = [found[f"LINKED_FLEET_ZENOH_{part}"] for part in ("CA", "CERT", "KEY")]
    assert [Path(name).name for name in names] == ["ca.crt", "tls.crt", "tls.key"]
    with pytest.raises(ValueError, match=str(names[1])):
        Credentials.from_optional_files(*names)
