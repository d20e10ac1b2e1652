"""What the files of the deployment say agrees with the rest of the repository, and with each other."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

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
    (ours,) = re.findall(r"^eclipse-zenoh==(.+)$", (ROOT / "constraints.txt").read_text(), re.M)
    assert re.findall(r"eclipse/zenoh:\$\{ZENOH_TAG:-(.+)\}", COMPOSE) == [ours]


def test_files_that_are_mounted_exist() -> None:
    mounted = re.findall(r'"\./([^:"]+):[^"]+"', COMPOSE + (ROOT / "deploy/fleet_check/compose.yaml").read_text())
    assert len(mounted) == 3
    assert [path for path in mounted if not (ROOT / path).is_file()] == []


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
    pins = re.findall(r"^(msgspec|eclipse-zenoh|rdflib)==(.+)$", (ROOT / "constraints.txt").read_text(), re.M)
    assert len(pins) == 3
    for name, version in pins:
        assert f"pkg:pypi/{name}@{version}" in parts
        assert f"\n{name} {version}: " in licences
    assert "linked-fleet" not in {part["name"] for part in parts.values()}, "it is what the bill is of"
    assert "Redistribution and use in source and binary forms" in licences, "the texts are there, msgspec's for one"


def test_the_bill_lists_what_pages_are_made_of_and_not_what_builds_them(tmp_path: Path) -> None:
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
