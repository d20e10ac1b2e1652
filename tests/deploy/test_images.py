"""The deployment files agree with the repository and with each other."""

import importlib
import importlib.metadata
import json
import re
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from linked_fleet_demo.tree import ROBOTS

ROOT = Path(__file__).parents[2]
COMPOSE = (ROOT / "docker-compose.yml").read_text()
DOCKERFILES = [(ROOT / "deploy" / f"{name}.Dockerfile").read_text() for name in ("agent", "gateway")]
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]


def test_images_have_the_version_of_the_package() -> None:
    labelled = re.findall(r'image\.version="([^"]+)"', "".join(DOCKERFILES))
    tagged = re.findall(r"image: linked-fleet/[\w-]+:(\S+)", COMPOSE)
    assert len(labelled) == len(tagged) == 2
    assert {*labelled, *tagged} == {VERSION}


def test_the_router_is_of_the_version_that_gateways_and_agents_speak() -> None:
    (ours,) = re.findall(r"^eclipse-zenoh==(.+)$", (ROOT / "deploy/constraints.txt").read_text(), re.M)
    assert re.findall(r"eclipse/zenoh:\$\{ZENOH_TAG:-(.+)\}", COMPOSE) == [ours]


def test_files_that_are_mounted_exist() -> None:
    mounted = re.findall(r'"\./([^:"]+):[^"]+"', COMPOSE + (ROOT / "deploy/fleet_check/compose.yaml").read_text())
    assert len(mounted) == 3
    assert [path for path in mounted if not (ROOT / path).is_file()] == []


def _robots(compose: str) -> set[str]:
    """Return the robots of the demo that have a service in a compose file."""
    return set(re.findall(rf"^  ({'|'.join(ROBOTS)}):$", compose, re.M))


def test_the_fleet_of_compose_has_the_robots_of_the_demo() -> None:
    """The check of that fleet awaits them, and each has a certificate of its own."""
    certificates = (ROOT / "deploy/certificates/compose.yaml").read_text()
    assert _robots(COMPOSE) == _robots(certificates) == set(ROBOTS)
    assert set(re.findall(r"--robot, (\w+)[],]", COMPOSE)) == set(ROBOTS)
    assert set(re.findall(r"/agents/(\w+)\.pem", certificates)) == set(ROBOTS)
    (checked,) = re.findall(r"^ROBOTS = \((.+)\)$", (ROOT / "deploy/fleet_check/checks.py").read_text(), re.M)
    assert set(re.findall(r"\w+", checked)) == set(ROBOTS)


@pytest.mark.parametrize("path", ["deploy/README.md", "deploy/certificates/compose.yaml"])
def test_the_command_that_makes_certificates_names_the_robots_of_the_demo(path: str) -> None:
    (agents,) = re.findall(r"--agent (\w+(?:,\w+){2,}) ", (ROOT / path).read_text())
    assert set(agents.split(",")) == {*ROBOTS, "door"}


@pytest.mark.parametrize("text", DOCKERFILES)
def test_images_run_as_nobody_in_particular(text: str) -> None:
    assert re.findall(r"^USER (\S+)$", text, re.M) == ["10001:10001"]


def _listed(folder: Path, *arguments: str) -> tuple[dict[str, dict[str, str]], str]:
    script = str(ROOT / "deploy" / "bill_of_materials.py")
    subprocess.run([sys.executable, script, str(folder), *arguments], check=True)
    bill = json.loads((folder / "sbom.cdx.json").read_text())
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.6")
    return {part["purl"]: part for part in bill["components"]}, (folder / "THIRD-PARTY-LICENCES.txt").read_text()


def test_the_bill_lists_each_package_with_its_licence(tmp_path: Path) -> None:
    parts, licences = _listed(tmp_path)
    pins = re.findall(r"^(msgspec|eclipse-zenoh|rdflib)==(.+)$", (ROOT / "deploy/constraints.txt").read_text(), re.M)
    assert len(pins) == 3
    for name, version in pins:
        assert f"pkg:pypi/{name}@{version}" in parts
        assert f"\n{name} {version}: " in licences
    assert "linked-fleet" not in {part["name"] for part in parts.values()}, "it is what the bill is of"
    assert "Redistribution and use in source and binary forms" in licences, "the texts are there, msgspec's for one"


def test_the_bill_lists_packages_of_pages_without_build_tools(tmp_path: Path) -> None:
    face = tmp_path / "face"
    packages = {"three": {}, "loader": {"dependencies": {"deep": "1"}}, "deep": {}, "bundler": {}}
    for name, more in packages.items():
        folder = face / "node_modules" / name
        folder.mkdir(parents=True)
        (folder / "package.json").write_text(json.dumps({"name": name, "version": "1.2.3", "license": "MIT", **more}))
        (folder / "LICENSE").write_text(f"Licence of {name}")
    wanted = {"dependencies": {"three": "1", "loader": "1"}, "devDependencies": {"bundler": "1"}}
    (face / "package.json").write_text(json.dumps(wanted))
    parts, licences = _listed(tmp_path / "doc", str(face))
    assert {purl for purl in parts if purl.startswith("pkg:npm/")} == {
        f"pkg:npm/{name}@1.2.3" for name in ("three", "loader", "deep")
    }
    assert "Licence of deep" in licences and "Licence of bundler" not in licences


REQUIREMENTS = sorted((ROOT / "deploy").glob("requirements*.txt"))
_PIN = re.compile(r"([A-Za-z0-9._-]+)==([A-Za-z0-9.!+]+)((?: --hash=sha256:[0-9a-f]{64})+)")


def _pins(path: Path) -> dict[str, str]:
    """Return versions by normalized name. Each line has a name, a version and hashes; the first is a comment."""
    head, *lines = path.read_text().splitlines()
    assert head.startswith("# Written by make requirements: ")
    found = {}
    for line in lines:
        match = _PIN.fullmatch(line)
        assert match, f"{path.name}: {line!r}"
        found[canonicalize_name(match[1])] = match[2]
    assert len(found) == len(lines)
    return found


def _requires(name: str) -> list[str]:
    try:
        return importlib.metadata.requires(name) or []
    except importlib.metadata.PackageNotFoundError:  # needed by another Python 3.11 than this one
        assert name == importlib.import_module("lock_requirements").BEFORE_3_11_3
        return []


def _needed(requirements: list[str]) -> set[str]:
    """Return these packages and their dependencies, by the metadata of the installed ones."""
    waiting, seen = [Requirement(text) for text in requirements], set[tuple[str, str]]()
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        for extra in ("", *requirement.extras):
            if (name, extra) not in seen:
                seen.add((name, extra))
                more = [Requirement(text) for text in _requires(name)]
                waiting += [each for each in more if each.marker is None or each.marker.evaluate({"extra": extra})]
    return {name for name, _ in seen}


@pytest.mark.parametrize("path", REQUIREMENTS, ids=lambda path: path.name)
def test_requirements_have_the_versions_of_the_constraints(path: Path) -> None:
    constraints = dict(re.findall(r"^([^#=]+)==(.+)$", (ROOT / "deploy/constraints.txt").read_text(), re.M))
    known = {canonicalize_name(name): version for name, version in constraints.items()}
    pins = _pins(path)
    assert pins and pins.items() <= known.items(), pins.items() - known.items()


def test_requirements_are_what_the_package_needs_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise run: make requirements."""
    monkeypatch.syspath_prepend(str(ROOT / "deploy"))
    wanted = importlib.import_module("lock_requirements").requirements_by_file()
    assert sorted(wanted) == [path.name for path in REQUIREMENTS]
    for name in ("requirements.txt", "requirements-agent.txt", "requirements-simulation.txt"):
        assert set(_pins(ROOT / "deploy" / name)) == _needed(wanted[name]), name
    for name in ("requirements-build.txt", "requirements-pages.txt"):
        asked = {canonicalize_name(Requirement(text).name) for text in wanted[name]}
        assert asked <= set(_pins(ROOT / "deploy" / name)), name


@pytest.mark.parametrize(
    "folder",
    ["gateway/linked_fleet_gateway/extensions/pages/scripts", "gateway/linked_fleet_gateway/extensions/things/tests"],
)
def test_npm_installs_pinned_packages_with_hashes_from_no_fixed_address(folder: str) -> None:
    """If not: make requirements."""
    wanted, lock = (json.loads((ROOT / folder / name).read_text()) for name in ("package.json", "package-lock.json"))
    own, *packages = lock["packages"].values()
    kinds = {"dependencies", "devDependencies"}
    assert {kind: own[kind] for kind in own.keys() & kinds} == {kind: wanted[kind] for kind in wanted.keys() & kinds}
    assert all(re.fullmatch(r"[\d.]+(-[\w.-]+)?", package["version"]) for package in packages)
    assert all(package["integrity"].startswith("sha512-") for package in packages)
    assert "://" not in json.dumps(lock)


@pytest.mark.parametrize("text", DOCKERFILES)
def test_images_are_built_on_an_exact_version_that_is_a_build_argument(text: str) -> None:
    stages = {stage for _, stage in re.findall(r"^FROM (\S+) AS (\S+)$", text, re.M)}
    bases = {base for base in re.findall(r"^FROM (\S+)", text, re.M) if base not in stages}
    assert bases == {"python:${PYTHON_TAG}"}
    (tag,) = re.findall(r"^ARG PYTHON_TAG=(\S+)$", text.partition("FROM ")[0], re.M)
    assert re.match(r"\d+\.\d+\.\d+-slim-", tag)
    assert f"${{PYTHON_TAG:-{tag}}}" in (ROOT / "deploy/fleet_check/compose.yaml").read_text()


def test_images_of_others_have_exact_versions_that_can_be_replaced() -> None:
    images = re.findall(r"^ +image: (?!linked-fleet/)(\S+)$", COMPOSE, re.M)
    assert len(images) == 3
    for image in images:
        assert re.fullmatch(r"[\w/]+:\$\{[A-Z]+_TAG:-\d+\.\d+\.\d+\}", image), image


@pytest.mark.parametrize("text", DOCKERFILES)
def test_images_install_nothing_without_a_hash(text: str) -> None:
    """Except the project's own wheel, which is built from the copied sources, without an index."""
    installs = re.findall(r"\bpip (?:--python \S+ )?(?:install|wheel|download) [^&\n]*", text)
    assert len(installs) >= 4
    for install in installs:
        hashed = re.search(r"--require-hashes -r deploy/(requirements[\w-]*\.txt)", install)
        assert hashed or "--no-index --no-deps" in install, install
        assert not hashed or (ROOT / "deploy" / hashed[1]).is_file()


@pytest.mark.parametrize("text", DOCKERFILES)
def test_copied_paths_are_in_the_build_context(text: str) -> None:
    """Each path exists, and .dockerignore, an allowlist, includes it."""
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    assert lines[1] == "*"
    let_in = [line[1:] for line in lines if line.startswith("!")]
    copied = [path for words in re.findall(r"^COPY (?!--from)(.+) \S+$", text, re.M) for path in words.split()]
    assert len(copied) > 5
    for path in copied:
        assert (ROOT / path).exists(), path
        assert any(fnmatch(path, each) or path.startswith(f"{each}/") for each in let_in), path
