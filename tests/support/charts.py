"""The Helm chart linked-fleet, as rendered for a set of values."""

import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from helm_program import ROOT, built

CHART = ROOT / "deploy" / "helm" / "linked-fleet"
SETS = sorted((CHART / "ci").glob("*-values.yaml"))
Document = dict[str, Any]
_OLDEST = "1.30.0"
_RELEASE = ("--namespace", "robots")


def helm(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a ``helm`` command that needs no cluster."""
    return subprocess.run([built(), *arguments], capture_output=True, text=True, check=False)


@cache
def rendered(values: Path, *more: str, version: str = _OLDEST) -> tuple[Document, ...]:
    """Return the objects of ``helm template`` for these values and this version of Kubernetes."""
    done = helm("template", "lf", CHART, "--values", values, "--kube-version", version, *_RELEASE, *more)
    assert done.returncode == 0, done.stderr
    return tuple(each for each in yaml.safe_load_all(done.stdout) if each)


def refused(*settings: str) -> str:
    """Return the message with which Helm refuses these settings (``name=value``)."""
    place = ("--kube-version", _OLDEST, *_RELEASE)
    done = helm("template", "lf", CHART, *place, *(word for each in settings for word in ("--set", each)))
    assert done.returncode != 0, done.stdout
    return done.stderr


def named(documents: tuple[Document, ...], kind: str, name: str) -> Document:
    (found,) = (each for each in documents if (each["kind"], each["metadata"]["name"]) == (kind, name))
    return found


def workloads(documents: tuple[Document, ...]) -> Iterator[Document]:
    """Yield the objects that have pods."""
    return (each for each in documents if each["kind"] in ("Deployment", "StatefulSet"))


def pod(workload: Document) -> Document:
    found: Document = workload["spec"]["template"]["spec"]
    return found


def container(workload: Document) -> Document:
    (found,) = pod(workload)["containers"]
    return dict(found)


def labels(workload: Document) -> dict[str, str]:
    found: dict[str, str] = workload["spec"]["template"]["metadata"]["labels"]
    return found


def selects(selector: Document, workload: Document) -> bool:
    """Return True if a selector by ``matchLabels`` selects the pods of this workload."""
    return bool(selector["matchLabels"].items() <= labels(workload).items())


def variables(workload: Document) -> dict[str, str]:
    """Return the environment variables with literal values; those from secrets are left out."""
    return {each["name"]: each["value"] for each in container(workload).get("env", ()) if "value" in each}


def secrets(documents: tuple[Document, ...]) -> set[str]:
    """Return the names of all secrets that pods use."""
    found = set()
    for workload in workloads(documents):
        found |= {each["secret"]["secretName"] for each in pod(workload)["volumes"] if "secret" in each}
        sources = [each.get("valueFrom", {}) for each in container(workload).get("env", ())]
        found |= {each["secretKeyRef"]["name"] for each in sources if "secretKeyRef" in each}
    return found
